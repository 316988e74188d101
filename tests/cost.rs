//! What fixed inputs cost, in counts: a slowdown is a difference in `tests/snapshots/cost.txt`, on whatever machine.

use crate::common;
use crate::snapshot;

use std::fmt::Write;
use std::path::Path;

use common::model;
use deltatwin::diagnosis::diagnose;
use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::excitation;
use deltatwin::identification::NoiseLevel;
use deltatwin::identification::{Dataset, fit};
use deltatwin::model::Model;
use deltatwin::planner::{self, Limits, Machine};
use deltatwin::recording::Recording;
use deltatwin::twin::{ContactWork, Options, Report, simulate};
use deltatwin_io::scenario;

const SNAPSHOT: &str = "tests/snapshots/cost.txt";

/// Head of the snapshot.
const HEAD: &str = "\
What fixed inputs cost, in counts: one line each with the count and the band around it that passes. Counts that no rounding
reaches must be equal. Those of iterations that end at a threshold differ by a few from processor to processor, as sums are
rounded differently: they may depart by a tenth, and by one at least where the count is two or more. A doubling always fails.
Corrections of the loops are listed where at least every second step needs one; whether fewer are needed, rounding decides.
";

/// A count, and by how much another machine may depart from it.
#[derive(Clone, Debug, PartialEq)]
struct Count {
    what: String,
    count: usize,
    band: usize,
}

impl Count {
    /// A count that is the same on every machine.
    fn exact(what: &str, count: usize) -> Self {
        Self { what: what.into(), count, band: 0 }
    }

    /// A count of iterations that end at a threshold.
    fn about(what: &str, count: usize) -> Self {
        let band = if count < 2 { 0 } else { (count / 10).max(1) };
        Self { what: what.into(), count, band }
    }

    fn line(&self) -> String {
        let band = if self.band == 0 { String::new() } else { format!(" ± {}", self.band) };
        format!("  {:<58}{:>8}{band}", self.what, self.count)
    }

    fn parse(line: &str) -> Option<Self> {
        let (what, numbers) = line.strip_prefix("  ")?.split_at_checked(58)?;
        let (count, band) = numbers.split_once('±').unwrap_or((numbers, "0"));
        let number = |text: &str| text.trim().parse().ok();
        Some(Self { what: what.trim().into(), count: number(count)?, band: number(band)? })
    }
}

/// A fixed input with its counts.
struct Group {
    name: String,
    counts: Vec<Count>,
}

fn text(groups: &[Group]) -> String {
    let mut text = HEAD.to_string();
    for Group { name, counts } in groups {
        write!(text, "\n{name}\n").expect("a string takes it");
        counts.iter().for_each(|c| writeln!(text, "{}", c.line()).expect("a string takes it"));
    }
    text
}

/// Lines of the snapshot that the counts depart from, and lines that are in one of both only.
fn departures(committed: &str, groups: &[Group]) -> Vec<String> {
    let mut known: Vec<(String, Count)> = Vec::new();
    let mut group = String::new();
    for line in committed.lines().skip(HEAD.lines().count()) {
        match Count::parse(line) {
            Some(count) => known.push((group.clone(), count)),
            None => group = line.into(),
        }
    }
    let mut wrong = Vec::new();
    for (Group { name, .. }, now) in groups.iter().flat_map(|g| g.counts.iter().map(move |c| (g, c))) {
        let Some(at) = known.iter().position(|(group, c)| group == name && c.what == now.what) else {
            wrong.push(format!("{name}: {}: {} is new", now.what, now.count));
            continue;
        };
        let before = known.remove(at).1;
        if before.count.abs_diff(now.count) > before.band {
            wrong.push(format!("{name}: {}: {} instead of{}", now.what, now.count, &before.line()[60..]));
        }
    }
    wrong.extend(known.into_iter().map(|(group, c)| format!("{group}: {} is gone", c.what)));
    wrong
}

/// A run of the twin along a shipped scenario for `duration` s, on a changed machine.
fn run(name: &str, duration: f64, change: impl Fn(&mut Model)) -> (Recording, Report) {
    let scenario =
        scenario::read(&crate::common::shipped(format!("scenarios/{name}.toml"))).expect("a shipped scenario");
    let mut machine = deltatwin_io::model::read(&scenario.model).expect("a shipped model");
    let planning = scenario.controller_model.as_ref().unwrap_or(&scenario.model);
    let planning = deltatwin_io::model::read(planning).expect("a shipped model");
    change(&mut machine);
    let motion = scenario.motion(&planning).expect("a motion");
    let believed = Plant::new(&planning, &scenario.setup);
    let options = Options { contacts: Some(deltatwin_cell::contacts), duration, ..Options::of(&scenario, &machine) };
    simulate(&machine, &scenario.setup, &believed, &|t| motion.at(t), &options, &mut |_| true).expect("a run")
}

/// Work of a run. Corrections that fewer than every second step needs hang on rounding, and are left out.
fn twin(what: &str, name: &str, duration: f64, change: impl Fn(&mut Model)) -> Group {
    let report = run(name, duration, change).1;
    let contacts = report.contacts;
    let touches = contacts != ContactWork::default();
    // Without contacts every step has the same length.
    let of_steps = if touches { Count::about } else { Count::exact };
    let mut counts = vec![
        of_steps("steps of the integrator", report.steps),
        Count::about("solutions of the equations of motion", report.solutions),
    ];
    if 2 * report.corrections > report.steps {
        counts.push(Count::about("Newton corrections that close the loops", report.corrections));
    }
    if touches {
        counts.extend([
            Count::about("contacts: searches for pairs", contacts.searches),
            Count::about("contacts: pairs whose points were computed", contacts.queries),
            Count::about("contacts: steps of the free objects", contacts.steps),
        ]);
    }
    Group { name: format!("twin: {what} ({name}.toml, {duration} s)"), counts }
}

/// A shape of the friction over the speed that the fit must find by iterations.
fn stribeck(machine: &mut Model) {
    let effect = find("drive_stribeck").expect("in the catalogue");
    machine.effects.push(ActiveEffect::new(effect, &[&[8.0], &[0.02], &[1900.0]]));
}

/// A law whose equations are solved again until the strut forces that it reads are those that come out.
fn load_dependent(machine: &mut Model) {
    let effect = find("ball_socket_load_dependent").expect("in the catalogue");
    machine.effects.push(ActiveEffect::absent(effect).at_nominal_size());
}

fn identification(what: &str, delivered: &Model, data: &Dataset) -> Group {
    let data = std::slice::from_ref(data);
    let work = fit(delivered, data, &NoiseLevel::of(delivered, data).of_each).expect("a fit").work;
    Group {
        name: format!("identification: {what}"),
        counts: vec![
            Count::about("passes that compute all columns", work.regressions),
            Count::about("passes that predict torques alone", work.predictions),
            Count::about("iterations to possible parameters", work.corrections),
        ],
    }
}

fn diagnosis(what: &str, delivered: &Model, data: &Dataset) -> Group {
    let d = diagnose(delivered, std::slice::from_ref(data), &[], &mut |_| {}).expect("a diagnosis");
    let draws = d.effects.iter().map(|e| e.confidence.draws * e.confidence.truths.len()).sum();
    Group {
        name: format!("diagnosis: {what}"),
        counts: vec![
            Count::exact("candidates", d.candidates.len()),
            Count::about("models fitted", d.work.fits),
            Count::about("their passes that compute all columns", d.work.fitting.regressions),
            Count::about("their passes that predict torques alone", d.work.fitting.predictions),
            Count::about("their iterations to possible parameters", d.work.fitting.corrections),
            Count::about("assessments of all candidates", d.work.rankings),
            Count::about("draws for the confidence", draws),
        ],
    }
}

fn plans() -> Vec<Group> {
    let model = model("irb360-6-1600");
    let task =
        deltatwin_io::plan::read(&crate::common::shipped("scenarios/u-turn.toml"), Limits::of(&model)).expect("a path");
    let plant = Plant::new(&model, &task.setup);
    let curve = task.shape.curve();
    let free = Limits { jerk: [f64::INFINITY; 4], ..task.limits };
    let one = |(what, limits): (&str, Limits)| {
        let machine = Machine::new(&plant, limits.detail);
        let found = planner::plan(&machine, &curve, &limits, &task.options).expect("a plan");
        Group {
            name: format!("plan: the U-turn {what} (u-turn.toml)"),
            counts: vec![
                Count::about("passes or programmes", found.iterations),
                Count::about("iterations of the interior-point solver", found.solver_iterations),
                Count::about("intervals of the last grid", found.profile.pieces.len()),
                Count::about("places at which it is checked", found.uses.len()),
            ],
        }
    };
    [("without jerk limits", free), ("with jerk limits", task.limits)].map(one).into()
}

fn design() -> Group {
    let options = excitation::Options { harmonics: 2, randoms: 12, starts: 1, iterations: 300, ..Default::default() };
    let design = excitation::design(&model("irb360-6-1600"), &options, &|| true).expect("a design");
    Group {
        name: "excitation: the robot".into(),
        counts: vec![Count::about("steps of all searches", design.iterations)],
    }
}

fn groups() -> Vec<Group> {
    let axis = model("servo-axis");
    let robot = model("irb360-6-1600");
    let on_axis = Dataset::new(&run("servo-axis", 5.0, stribeck).0);
    let on_robot = Dataset::new(&run("excitation", 4.0, |_| ()).0);
    let mut bent = axis.clone();
    stribeck(&mut bent);
    bent.effects.iter_mut().for_each(|a| a.values.iter_mut().for_each(|v| *v *= 1.5));
    let on_loaded = Dataset::new(&run("excitation", 4.0, load_dependent).0);
    let mut rubbing = robot.clone();
    rubbing.effects.push(ActiveEffect::absent(find("ball_socket_load_dependent").expect("in the catalogue")));
    let smooth = |machine: &mut Model| machine.effects.clear();
    let mut all = vec![
        twin("without friction", "smoke", 0.5, smooth),
        twin("with all friction", "smoke", 0.5, |_| ()),
        twin("with friction that reads the strut forces", "smoke", 0.5, load_dependent),
        twin("an axis", "servo-axis", 1.0, |_| ()),
        twin("a touch", "touch", 1.6, |_| ()),
        twin("picking", "pick-and-place", 0.4, |_| ()),
        twin("a crash", "crash", 0.3, |_| ()),
        identification("an axis whose friction has a shape", &bent, &on_axis),
        identification("the robot as delivered", &robot, &on_robot),
        identification("the robot with friction that reads the strut forces", &rubbing, &on_loaded),
        diagnosis("an axis with Stribeck friction", &axis, &on_axis),
        diagnosis("the robot with friction in its sockets", &robot, &on_robot),
        design(),
    ];
    all.extend(plans());
    all
}

#[test]
#[ignore = "campaign"]
fn fixed_inputs_cost_what_they_did() {
    common::at_root();
    let (file, groups) = (Path::new(SNAPSHOT), groups());
    if snapshot::accepts() {
        std::fs::write(file, text(&groups)).expect("the snapshot is written");
    }
    let committed = std::fs::read_to_string(file).expect("a committed snapshot");
    let wrong = departures(&committed, &groups);
    assert!(wrong.is_empty(), "{}\n\n{}", wrong.join("\n"), snapshot::how_to_accept(file));
}

/// Every line of the snapshot that is not zero fails where its count is doubled, and none fails as it stands.
#[test]
fn a_doubling_fails_on_every_line() {
    let committed = std::fs::read_to_string(common::root().join(SNAPSHOT)).expect("a committed snapshot");
    let mut groups: Vec<Group> = Vec::new();
    for line in committed.lines().skip(HEAD.lines().count()).filter(|l| !l.is_empty()) {
        match Count::parse(line) {
            Some(count) => groups.last_mut().expect("a group before its counts").counts.push(count),
            None => groups.push(Group { name: line.into(), counts: Vec::new() }),
        }
    }
    let lines: usize = groups.iter().map(|g| g.counts.len()).sum();
    assert!(lines > 40 && committed == text(&groups), "{lines} lines");
    assert_eq!(departures(&committed, &groups), Vec::<String>::new());
    for (i, k) in
        groups.iter().enumerate().flat_map(|(i, g)| (0..g.counts.len()).map(move |k| (i, k))).collect::<Vec<_>>()
    {
        let before = groups[i].counts[k].clone();
        groups[i].counts[k].count *= 2;
        assert_eq!(departures(&committed, &groups).len(), usize::from(before.count > 0), "{before:?}");
        groups[i].counts[k] = before;
    }
}
