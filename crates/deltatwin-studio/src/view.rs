//! What windows see: the state, columns of a recording, differences of models, and the page that is kept.

use std::path::Path;

use deltatwin::dynamics::Plant;
use deltatwin::effects::formula::{Place, Variable};
use deltatwin::effects::{REGISTRY, rigid_bodies};
use deltatwin::machine::Setup;
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin_analysis::law;
use deltatwin_io::recording::setup::{self, Sidecar};
use deltatwin_io::recording::{Mapping, Preview, Reading, preview};
use deltatwin_io::{model, recording};
use deltatwin_report::{Callout, Report};
use miette::{IntoDiagnostic, miette};
use serde_json::{Value, json};

use crate::session::Session;
use crate::studio::Studio;
use deltatwin_io::model::shipped::SHIPPED;

/// The state of the session.
pub(crate) fn state(studio: &Studio) -> Value {
    let inner = studio.lock();
    let mut session = json!(inner.session);
    // What is kept of other inputs grows, and no window shows it.
    for apart in ["kept", "earlier", "left_out"] {
        session[apart].take();
    }
    let versions = session["versions"].as_array_mut().into_iter().flatten();
    for (version, own) in versions.zip(&inner.session.versions) {
        version["known"].take();
        version["role"] = own.role().class().into();
    }
    let recordings = session["recordings"].as_array_mut().into_iter().flatten();
    for (recording, own) in recordings.zip(&inner.session.recordings) {
        // A sidecar that cannot be read is reported where the recording is read.
        let maps = own.maps(studio.folder()).unwrap_or_default();
        recording["maps"] = maps.iter().map(Mapping::to_string).collect();
        recording["payload_mass"] = json!(own.payload_mass(studio.folder()).ok().flatten());
    }
    json!({
        "revision": inner.revision,
        "message": inner.message,
        "term": inner.term,
        "job": inner.job.as_ref().map(|job| job.json()),
        "session": session,
        "chain": inner.session.chain(),
        "folder": studio.folder().display().to_string(),
        "viewer": cfg!(feature = "viewer"),
        "shown": inner.shown,
        "saved": studio.folder().join(REPORT).is_file(),
    })
}

/// What comes with the program: models, and effects with what they are.
pub(crate) fn shipped() -> Value {
    let effects = REGISTRY.iter().filter(|e| e.name() != rigid_bodies::NAME).map(|e| {
        let about = &e.spec().about;
        json!({"name": e.name(), "summary": about.summary, "law": about.law, "shows": about.shows})
    });
    json!({"models": SHIPPED.map(|(name, _)| name), "effects": effects.collect::<Vec<_>>()})
}

/// Name of the page that is kept.
pub const REPORT: &str = "report.html";

/// Columns of recording `index`, with what they are read as; of a bag its channels.
pub(crate) fn columns(studio: &Studio, index: usize) -> miette::Result<Value> {
    let session = studio.lock().session.clone();
    let recording = session.recordings.get(index).ok_or_else(|| miette!("there is no such recording"))?;
    let file = studio.folder().join(&recording.file);
    let inputs = session.inputs(studio.folder())?;
    let machine = session.current.and_then(|k| model::read(&studio.folder().join(&session.versions[k].file)).ok());
    let how = inputs.reading(machine.as_ref().map(|m| m.mechanism));
    // Later mappings refer to what the first has read, not to columns of the file.
    let beside = setup::sidecar(&file);
    let own = if beside.is_file() { Sidecar::read(&beside).unwrap_or_default() } else { Sidecar::default() };
    let first: Vec<Mapping> = own.assignments().chain(&inputs.maps).take(1).cloned().collect();
    let read = recording::read_as(&file, &how);
    let short = |text: String| text.replace(&format!("{}/", studio.folder().display()), "");
    let problem = read.as_ref().err().map(|e| short(chain(e)));
    let warnings: Vec<String> = read.as_ref().map(|(_, w)| w.iter().cloned().map(short).collect()).unwrap_or_default();
    let table = preview(&file, &Reading { maps: &first, ..how });
    let is_table = table.is_ok();
    let (rows, shown) = match (table, &read) {
        (Ok(Preview { rows, columns, .. }), _) => {
            let one = |c: deltatwin_io::recording::PreviewColumn| json!({"name": c.name, "channel": c.channel, "stretches": numbers(&c.stretches), "first": c.first});
            (rows, columns.into_iter().map(one).collect())
        }
        (Err(_), Ok((recording, _))) => (recording.signals.len(), channels(recording)),
        (Err(e), Err(_)) => return Err(miette!("{}", short(e.to_string()))),
    };
    Ok(
        json!({"file": recording.file, "rows": rows, "table": is_table, "columns": shown, "problem": problem, "warnings": warnings}),
    )
}

/// An error with its causes and what was expected.
fn chain(error: &deltatwin_io::recording::ReadError) -> String {
    let help = miette::Diagnostic::help(error).map_or(String::new(), |h| format!("; {h}"));
    format!("{error}{help}")
}

/// Pairs of numbers; null where there are none.
fn numbers(stretches: &[[f64; 2]]) -> Value {
    stretches.iter().map(|pair| if pair[0].is_finite() { json!(pair) } else { Value::Null }).collect()
}

/// Channels of a recording in the form of columns.
fn channels(recording: &deltatwin::recording::Recording) -> Value {
    let s = &recording.signals;
    let ends =
        |values: &[f64]| values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(*x), b.max(*x)]);
    let column = |(channel, values): (Channel, &[f64])| {
        let stretches: Vec<_> = values.chunks(values.len().div_ceil(400).max(1)).map(ends).collect();
        let name = channel.to_string();
        json!({"name": name, "channel": name, "stretches": numbers(&stretches), "first": []})
    };
    s.series().filter(|(channel, _)| matches!(channel, Channel::Angle(_) | Channel::Torque(_))).map(column).collect()
}

/// Longest law that is looked at while it is typed, bytes.
const LONGEST_LAW: usize = 4096;

/// What is to be said about a typed law: the unit of its coefficient, or what is wrong and where (characters from, to).
pub(crate) fn formula(studio: &Studio, at: &str, law: &str) -> Value {
    let session = studio.lock().session.clone();
    let model = session.current.and_then(|k| model::read(&studio.folder().join(&session.versions[k].file)).ok());
    let machine = model.map(|m| m.mechanism).unwrap_or_default();
    let places: Vec<&str> = Place::on(machine).map(Place::name).collect();
    let variables: Vec<&str> =
        Variable::names().filter(|name| Variable::named(name).is_some_and(|v| v.exists_on(machine))).collect();
    let known = json!({"places": places, "variables": variables});
    if law.len() > LONGEST_LAW {
        let problem = format!("is longer than {LONGEST_LAW} bytes; expected a shorter law");
        return json!({"problem": problem, "from": 0, "to": 0, "known": known});
    }
    let mut answer = match law::checked(machine, at, law) {
        Ok((_, _, unit)) => json!({"unit": unit.to_string()}),
        Err(e) => {
            let characters = |byte: usize| law.get(..byte).unwrap_or(law).encode_utf16().count();
            json!({"problem": e.problem, "from": characters(e.at.start), "to": characters(e.at.end)})
        }
    };
    answer["known"] = known;
    answer
}

/// Parameters and effects in which a version differs from the one that it was made from.
pub(crate) fn difference(studio: &Studio, version: usize) -> miette::Result<Value> {
    let session = studio.lock().session.clone();
    let own = session.versions.get(version).ok_or_else(|| miette!("there is no such version"))?;
    let Some(parent) = own.parent else { return Ok(json!({"effects": [], "parameters": []})) };
    let read = |file: &str| model::read(&studio.folder().join(file));
    let (before, after) = (read(&session.versions[parent].file)?, read(&own.file)?);
    let names = |m: &Model| m.effects.iter().map(|a| a.effect.name().to_string()).collect::<Vec<_>>();
    let (old, new) = (names(&before), names(&after));
    let mut effects: Vec<String> = new.iter().filter(|n| !old.contains(n)).map(|n| format!("+ {n}")).collect();
    effects.extend(old.iter().filter(|n| !new.contains(n)).map(|n| format!("− {n}")));
    let table = |m: &Model| Plant::new(m, &Setup::default()).parameters();
    let (earlier, later) = (table(&before), table(&after));
    let (first, last) = (earlier.values(), later.values());
    let row = |(i, p): (usize, &deltatwin::dynamics::PlantParameter)| {
        let was = earlier.index(p.param).map(|k| first[k]);
        let changed = was.is_none_or(|w| (w - last[i]).abs() > 1e-9 * w.abs().max(last[i].abs()));
        changed.then(|| json!({"name": p.name, "before": was, "after": last[i], "unit": p.unit.to_string()}))
    };
    let rows: Vec<Value> = later.iter().enumerate().filter_map(row).collect();
    Ok(json!({"effects": effects, "parameters": rows}))
}

/// Writes the page of the session: its model's chain, the results of all stages, and the commands.
///
/// # Errors
/// If nothing has been done yet, or a file cannot be read or written.
pub(crate) fn save(folder: &Path, session: &Session) -> miette::Result<()> {
    let Some(current) = session.current.filter(|_| !session.stages.is_empty()) else {
        return Err(miette!("there is nothing to save yet"));
    };
    let files: Vec<&str> = session.recordings.iter().map(|r| r.file.as_str()).collect();
    let name = model::read(&folder.join(&session.versions[0].file))?.name;
    let mut page = Report::new(format!("{name}: session"), format!("with {}", files.join(", ")));
    let chain = session.chain();
    page.heading("The error falls");
    let errors = |k: &usize| session.versions[*k].errors.as_ref();
    if let Some(last) = errors(&current) {
        let known: Vec<usize> = chain.iter().copied().filter(|k| errors(k).is_some()).collect();
        let mut headers = vec![format!("RMS{}", if last.held_out { ", held out" } else { "" })];
        headers.extend(known.iter().map(|k| session.versions[*k].what.clone()));
        headers.push("noise floor".into());
        let row = |c: usize| {
            let mut cells = vec![format!("{} / {}", last.channels[c], last.units[c])];
            let value = |k: &usize| errors(k).and_then(|e| e.rms.get(c)).map_or("–".into(), |x| number(*x));
            cells.extend(known.iter().map(value));
            cells.push(number(last.noise_floor[c]));
            cells
        };
        let rows: Vec<Vec<String>> = (0..last.channels.len()).map(row).collect();
        page.table(&headers, &rows);
    }
    let titles = [("check", "Check"), ("fit", "Fit"), ("where", "Where"), ("why", "Why"), ("add", "Add")];
    for (stage, title) in titles {
        // The residuals of another version say nothing of the one in use.
        let known = session.stages.get(stage).filter(|r| stage != "where" || r.version == current);
        let Some(result) = known else { continue };
        page.heading(title);
        page.callout(if result.good { Callout::Note } else { Callout::Bad }, &result.message);
        let part = session.part(folder, stage).and_then(|file| std::fs::read_to_string(file).ok());
        page.fragment_of(&part.unwrap_or_default());
    }
    page.heading("The same on the command line");
    let mut commands: Vec<String> = session.stages.get("check").map(|c| c.command.clone()).into_iter().collect();
    commands.extend(chain.iter().map(|k| session.versions[*k].command.clone()).filter(|c| !c.is_empty()));
    commands.extend(session.stages.get("why").map(|c| c.command.clone()));
    page.commands(&commands.join("\n"));
    page.write(folder.join(REPORT)).into_diagnostic()
}

fn number(x: f64) -> String {
    deltatwin::text::significant(x, 4)
}
