//! `deltatwin reproduce`.

use std::path::PathBuf;
use std::time::Instant;

use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Map, Value, json};

use crate::terminal::{DONE, INTERRUPTED, bar, catch_interrupt, interrupted, origin_of, path, say, spinner};
use deltatwin_analysis::page::end;
use deltatwin_io::file::replace_text;
use deltatwin_validation::reproduce::runs::Campaign;
use deltatwin_validation::reproduce::{self, inputs, markdown, sections};

/// Repeat the paper's experiments on the twin and set the results beside the paper's numbers.
///
/// Writes a page, as `reproduce.html` and as `reproduce.md` with its figures, and all recordings.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin reproduce -o recordings/reproduce --seed 2")]
pub struct Args {
    /// Folder for the page, its figures and the recordings.
    #[arg(short, long, default_value = "recordings/reproduce", value_name = "DIR")]
    pub output: PathBuf,
    /// Draws the sensor noise.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder of other scenarios than the shipped ones, which the program carries and writes to `inputs` in the output folder.
    #[arg(long, value_name = "DIR")]
    pub scenarios: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let start = Instant::now();
    let folder = &args.output;
    std::fs::create_dir_all(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    let scenarios = match &args.scenarios {
        Some(folder) => folder.clone(),
        None => {
            let inputs = folder.join("inputs");
            inputs::unpack(&inputs)
                .into_diagnostic()
                .wrap_err_with(|| format!("cannot write the scenarios to {}", inputs.display()))?
        }
    };
    catch_interrupt()?;
    const STEPS: f64 = 1e4;
    let progress = bar("measure", STEPS as u64);
    let done = std::sync::Mutex::new(0.0);
    let campaign = Campaign::run(&scenarios, args.seed, &|share| {
        if let Ok(mut done) = done.lock() {
            *done += share * STEPS;
            progress.set_position(*done as u64);
        }
        !interrupted()
    });
    progress.finish_and_clear();
    if interrupted() {
        return Ok(INTERRUPTED);
    }
    let campaign = campaign?;
    let working = spinner("identify");
    let sections = sections(&campaign, &|stage| working.set_message(stage.to_string()));
    let sections = sections?;
    working.set_message("write");
    for recording in campaign.recordings() {
        deltatwin_io::recording::write(recording, &folder.join(format!("{}.mcap", recording.name)))
            .into_diagnostic()?;
    }
    let write = |name: &str, text: &str| {
        let file = folder.join(name);
        replace_text(&file, text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", file.display()))
    };
    for plot in sections.iter().flat_map(|s| &s.plots) {
        write(&format!("{}.svg", plot.name), plot.figure.svg())?;
    }
    write("reproduce.md", &markdown(&sections))?;
    let page = folder.join("reproduce.html");
    let mut report = reproduce::page(&sections);
    end(&mut report, &origin_of("reproduce", &[])?);
    report.write(&page).into_diagnostic()?;
    working.finish_and_clear();
    let wall = start.elapsed().as_secs_f64();
    if args.json {
        let results: Map<String, Value> = sections.iter().map(|s| (s.key.to_string(), s.json())).collect();
        say(json!({ "seed": args.seed, "page": path(&page), "wall_s": wall, "results": results }))?;
    } else {
        for section in &sections {
            say(format!("{}\n  {}\n", section.title, section.agreement))?;
        }
        say(format!("Wrote {} with its figures and recordings in {wall:.0} s", page.display()))?;
    }
    Ok(DONE)
}
