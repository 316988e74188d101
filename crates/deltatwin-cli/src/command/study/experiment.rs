//! Virtual excitation experiments: what the diagnosis would find.

use std::path::PathBuf;

use deltatwin::text::significant;
use deltatwin_analysis::page::end;
use deltatwin_io::study::{Factor, Study};
use deltatwin_report::figure::Rate;
use deltatwin_report::figure::study::{Banded, ProbabilityCurve, power};
use deltatwin_report::{KeyNumber, StudyPage, StudySection, study_page};
use deltatwin_study::campaign::parquet::Reader;
use deltatwin_study::campaign::{CampaignError, Chunk, Held, Table as Rows, Value};
use deltatwin_study::statistics::{PowerCurve, power_curves, wilson};
use deltatwin_validation::exam::experiment::{Experiments, attempts, by_level};
use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::json;

use super::progress::Progress;
use super::{Args, COMPLETE, command, merge_help, told};
use crate::terminal::{Table, origin_of, path, say, wrapped, write_figure};

/// Confidence of intervals, and the probability of naming at which an effect counts as found.
const CONFIDENCE: f64 = 0.95;
const FOUND: f64 = 0.8;
/// Groups of sizes of a power curve, and points of its fit.
const GROUPS: usize = 8;
const POINTS: usize = 101;

/// Runs a study of experiments.
pub fn run(args: &Args, study: Study) -> miette::Result<u8> {
    if args.run.is_some() {
        return Err(miette!("an experiment has no run of the twin to be shown; its row has everything"));
    }
    let experiments = Experiments::new(study, &args.output.clone().unwrap_or_default())?;
    if args.force {
        experiments.campaign.clear()?;
    }
    let merge = || experiments.campaign.merge(Some(experiments.runs())).map_err(|e| merge_help(args, e));
    if args.merge {
        merge()?;
        return tell(args, &experiments);
    }
    let open = args.chunk.is_some() || experiments.campaign.held()? == Held::Open;
    if open {
        let chunk = args.chunk.unwrap_or(Chunk::WHOLE);
        let range = chunk.range(experiments.runs());
        let right = experiments.campaign.headings.iter().position(|h| h.name == "right");
        let progress = Progress::new(range.end - range.start, (right, "not found"));
        let end = experiments.chunk(chunk, &progress);
        progress.finish();
        match end {
            Err(CampaignError::Interrupted) => return Ok(told::interrupted(args)),
            end => end?,
        }
        if args.chunk.is_some() {
            say(format!(
                "Wrote {}: runs {} to {}",
                experiments.campaign.part(chunk).display(),
                range.start,
                range.end.saturating_sub(1)
            ))?;
            say(format!("Next, when all {} parts are there:\n  {}", chunk.of(), command(args, "--merge")))?;
            return Ok(COMPLETE);
        }
        merge()?;
    }
    experiments.campaign.remove_parts()?;
    tell(args, &experiments)
}

/// Counts of right answers: level, right, of.
type Counts = Vec<(String, u64, u64)>;

fn counts(rows: &Rows, factor: &str) -> Counts {
    let object = by_level(rows, factor);
    let number = |v: &serde_json::Value, key: &str| v[key].as_u64().unwrap_or(0);
    let levels = object.as_object().into_iter().flatten();
    levels.map(|(level, v)| (level.clone(), number(v, "count"), number(v, "of"))).collect()
}

fn tell(args: &Args, experiments: &Experiments) -> miette::Result<u8> {
    let file = experiments.campaign.table();
    let content = |reason| CampaignError::Content { file: file.clone(), reason };
    let rows = Reader::open(&file).and_then(|reader| reader.table()).map_err(content)?;
    let study = &experiments.study;
    let by = |key: &str| study.factors.iter().find(|f| f.keys.iter().any(|k| k == key)).map(|f| f.name.as_str());
    let curves = power_curves(&attempts(&rows, by("duration")), GROUPS);
    let files = pictures(args, experiments, &rows, &curves)?;
    let right = rows.column("right").map_or(0, |c| rows.rows.iter().filter(|row| row[c] == Value::Flag(true)).count());
    if args.json {
        let levels = |f: &Factor| (f.name.clone(), by_level(&rows, &f.name));
        let found = |c: &PowerCurve| json!({ "length": c.length, "found": c.detectable(FOUND) });
        say(json!({
            "study": study.name,
            "digest": experiments.campaign.digest.hex(),
            "build": experiments.campaign.build,
            "runs": rows.rows.len(),
            "right": right,
            "by": study.factors.iter().map(levels).collect::<serde_json::Map<_, _>>(),
            "power": curves.iter().map(found).collect::<Vec<_>>(),
            "table": path(&file),
            "page": path(&files[0]),
        }))?;
        return Ok(COMPLETE);
    }
    let title = study.title.as_ref().map_or(String::new(), |title| format!(": {title}"));
    say(wrapped(&format!("{}{title}", study.name), 0))?;
    say(wrapped(&share("right answers", right as u64, rows.rows.len() as u64), 2))?;
    for factor in &study.factors {
        let mut table = Table::new(&[&factor.name, "right", "of", "95 % interval"], &[]);
        for (level, count, of) in counts(&rows, &factor.name) {
            let [low, high] = wilson(count as usize, of as usize, CONFIDENCE).map(|x| 1e2 * x);
            table.row([level, count.to_string(), of.to_string(), format!("{low:.0} to {high:.0} %")]);
        }
        say(table)?;
    }
    for curve in &curves {
        if let Some([size, low, high]) = curve.detectable(FOUND) {
            let [size, low, high] = [size, low, high].map(|x| significant(x, 2));
            say(wrapped(
                &format!(
                    "{} s: an effect of {size} times the noise after a refit ({low} to {high}) is named in four of five cases",
                    curve.length
                ),
                2,
            ))?;
        }
    }
    say(format!("  Wrote {} and {}", file.display(), files[0].display()))?;
    say(format!("  Next: {}", command(args, "--json")))?;
    Ok(COMPLETE)
}

fn share(what: &str, count: u64, of: u64) -> String {
    let [low, high] = wilson(count as usize, of as usize, CONFIDENCE).map(|x| 1e2 * x);
    format!("{what}: {count} of {of} (95 % interval {low:.0} to {high:.0} %)")
}

fn pictures(
    args: &Args,
    experiments: &Experiments,
    rows: &Rows,
    curves: &[PowerCurve],
) -> miette::Result<Vec<PathBuf>> {
    let curve = |c: &PowerCurve| {
        let point = |t: &deltatwin_study::statistics::Trial| {
            let [low, high] = wilson(t.failures, t.of, CONFIDENCE);
            Rate { x: t.demand, share: t.failures as f64 / t.of as f64, low, high, of: t.of }
        };
        let points: Vec<Rate> = c.groups.iter().map(point).collect();
        let (low, high) = points.iter().fold((f64::INFINITY, 0.0f64), |(a, b), p| (a.min(p.x), b.max(p.x)));
        let at = |fit: &deltatwin_study::statistics::Fragility, k: usize| {
            let x = low * (high / low).powf(k as f64 / (POINTS - 1) as f64);
            let [value, low, high] = fit.band(x, CONFIDENCE);
            Banded { x, value, low, high }
        };
        let fit = c.fit.as_ref().ok().filter(|_| low > 0.0 && high > low);
        ProbabilityCurve {
            name: format!("{} s", c.length),
            points,
            fit: fit.map_or_else(Vec::new, |fit| (0..POINTS).map(|k| at(fit, k)).collect()),
            mark: c.detectable(FOUND).filter(|mark| (low..=high).contains(&mark[0])),
        }
    };
    let study = &experiments.study;
    let page = args.output.clone().unwrap_or_default().join("study.html");
    let mut files = vec![page.clone()];
    let mut sections = Vec::new();
    if !curves.is_empty() {
        let all: Vec<ProbabilityCurve> = curves.iter().map(curve).collect();
        let figure = power("What would be found", "effect after a refit, RMS / noise", &all);
        let file = page.with_file_name("power.svg");
        write_figure(&file, &figure)?;
        files.push(file);
        let caption =
            "Shares of hidden effects that are named, with 95 % intervals (Wilson), and lognormal curves of greatest \
                       likelihood, one per length of the recording."
                .into();
        sections.push(StudySection {
            heading: "Power".into(),
            figures: vec![(figure, caption)],
            ..StudySection::default()
        });
    }
    for factor in &study.factors {
        let row = |(level, count, of): (String, u64, u64)| {
            let [low, high] = wilson(count as usize, of as usize, CONFIDENCE).map(|x| 1e2 * x);
            vec![level, count.to_string(), of.to_string(), format!("{low:.0} to {high:.0} %")]
        };
        let header = [factor.name.as_str(), "right", "of", "95 % interval"].map(String::from).to_vec();
        sections.push(StudySection {
            heading: format!("By {}", factor.name.replace('_', " ")),
            table: Some((header, counts(rows, &factor.name).into_iter().map(row).collect())),
            ..StudySection::default()
        });
    }
    let right = rows.column("right").map_or(0, |c| rows.rows.iter().filter(|row| row[c] == Value::Flag(true)).count());
    let content = StudyPage {
        title: study.title.clone().unwrap_or_else(|| study.name.clone()),
        subtitle: format!("{} experiments, seed {}", rows.rows.len(), study.seed),
        numbers: vec![KeyNumber {
            value: format!("{right} of {}", rows.rows.len()),
            label: "right answers".into(),
            note: String::new(),
        }],
        sections,
        commands: vec![("The whole study".into(), command(args, ""))],
        ..StudyPage::default()
    };
    let mut report = study_page(&content);
    end(&mut report, &origin_of("study", &[("study", &args.study)])?);
    report.write(&page).into_diagnostic().wrap_err("the page cannot be written")?;
    Ok(files)
}
