//! Conversion of a bag's messages to checked signals.

use std::collections::HashMap;
use std::path::Path;

use deltatwin::machine::{Joint, Mechanism, Setup};
use deltatwin::recording::{Contacts, Signals};

use super::content::{Content, Messages, Rows, Shape, States, Stream, Wanted};
use super::{EPOCH, EXPECTED, MECHANISMS, folder, read_file, topics};
use crate::recording::check::{self, Column, Table};
use crate::recording::columns;
use crate::recording::{ReadError, Reading, memory, setup};

/// Signals of a bag, its setup if it contains one, and warnings about what was repaired.
///
/// `path` is an MCAP or SQLite file, or a bag folder; a truncated file is read up to its last complete chunk.
/// `how.machine` is the expected machine; `None` means the one stated in the bag or inferred from its joints, or a
/// single axis if `how.joint` names one of several. `how.maps` assign columns to channels.
///
/// # Errors
/// A [`ReadError`] if a file cannot be read, the bag contains no usable joint states, or the signals fail the checks.
pub fn read(path: &Path, how: &Reading) -> Result<(Signals, Option<Setup>, Vec<String>), ReadError> {
    let (mut content, mut warnings) = content_of(path, Wanted::Signals, how.max_memory)?;
    let setup = match content.metadata.get("setup").and_then(|m| m.get("toml")) {
        Some(text) => Some(setup::from_toml(text, &format!("{}[setup]", path.display()))?),
        None => None,
    };
    let (times, joints) = joint_states(path, &mut content, &mut warnings)?;
    let noted = noted_machine(&content);
    if let (Some(wanted), Some(noted)) = (how.machine, noted)
        && wanted.effort() != noted.effort()
    {
        let unit = |m: Mechanism| m.unit(deltatwin::machine::Unit::NM);
        let problem = format!("states the effort of its axis in {}", unit(noted));
        return Err(ReadError::content(path, problem, format!("{}, the unit of the model", unit(wanted))));
    }
    let lone = how.joint.map(|_| Mechanism::axis(Joint::Revolute));
    let machine = how.machine.or(lone).or(noted).unwrap_or_else(|| machine_of(&joints));
    if how.joint.is_some() {
        // They are about all axes.
        content.streams.retain(|s| !topics::is_optional(&s.topic));
    }
    let samples = Samples::of(path, &times, &joints, machine, how.joint, &mut warnings)?;
    drop((times, joints));
    let zero = zero_of(&content);
    let (table, start) = samples.table(path, machine, zero, &content, &mut warnings);
    drop(content);
    let (table, mapped) = columns::remap(table, how)?;
    let (mut signals, noticed) = check::signals(table)?;
    signals.start = Some(start).filter(|s| *s != EPOCH);
    warnings.extend(mapped.into_iter().chain(noticed));
    Ok((signals, setup, warnings))
}

/// Contacts in a bag that states its instant of t = 0, in order of time; none in others.
///
/// # Errors
/// A [`ReadError`] if a file cannot be read.
pub fn contacts(path: &Path) -> Result<Vec<Contacts>, ReadError> {
    let (content, _) = content_of(path, Wanted::Contacts, None)?;
    let Some(zero) = zero_of(&content) else { return Ok(Vec::new()) };
    let seconds = |time: u64| (time as i64).wrapping_sub(zero) as f64 / 1e9;
    let of = |stream: Stream| match stream.messages {
        Messages::Contacts(all) => stream.times.into_iter().zip(all).map(|(t, pairs)| (seconds(t), pairs)).collect(),
        Messages::States(_) | Messages::Rows(_) => Vec::new(),
    };
    let found = content.streams.into_iter().flat_map(of);
    Ok(found.map(|(t, pairs)| Contacts { t, pairs }).collect())
}

/// What is wanted of a bag, with warnings about what was repaired.
fn content_of(path: &Path, wanted: Wanted, memory: Option<u64>) -> Result<(Content, Vec<String>), ReadError> {
    let mut warnings = Vec::new();
    let mut content = Content::new(wanted, memory::for_messages(memory));
    if path.is_dir() {
        folder::read(path, &mut content, &mut warnings)?;
    } else {
        read_file(path, &mut content, &mut warnings)?;
    }
    Ok((content, warnings))
}

/// Instant of t = 0 that a bag states, ns since 1970.
fn zero_of(content: &Content) -> Option<i64> {
    content.metadata.get("run").and_then(|m| m.get("zero_ns")?.parse().ok())
}

/// Removes and returns the log times (ns) and messages of the stream with the robot's joint states.
fn joint_states(
    path: &Path,
    content: &mut Content,
    warnings: &mut Vec<String>,
) -> Result<(Vec<u64>, States), ReadError> {
    let is_state = |s: &Stream| matches!(s.messages, Messages::States(_));
    let filled: Vec<usize> = (0..content.streams.len())
        .filter(|&i| is_state(&content.streams[i]) && !content.streams[i].times.is_empty())
        .collect();
    let usual = filled.iter().find(|&&i| content.streams[i].topic == topics::JOINTS);
    let chosen = usual.or(filled.first()).map(|&i| content.streams.swap_remove(i));
    let Some(Stream { topic, times, messages: Messages::States(states), .. }) = chosen else {
        let problem = match &content.unread {
            Some(encoding) => format!("has JointState messages in the encoding `{encoding}`"),
            None if content.streams.iter().any(is_state) => "has a JointState topic without messages".into(),
            None => format!("has no JointState messages (topics: {})", content.topics()),
        };
        let cut = if content.cut { " and is cut short or damaged" } else { "" };
        return Err(ReadError::content(path, problem + cut, format!("{EXPECTED} in CDR")));
    };
    if filled.len() > 1 {
        warnings.push(format!("several topics carry JointState; `{topic}` is read"));
    }
    Ok((times, states))
}

/// The machine stated in the bag, if any.
fn noted_machine(content: &Content) -> Option<Mechanism> {
    let noted = content.metadata.get("machine")?.get("mechanism")?;
    MECHANISMS.iter().find(|(name, _)| name == noted).map(|(_, machine)| *machine)
}

/// The machine with as many axes as there are joints.
fn machine_of(joints: &States) -> Mechanism {
    let axes = |shape: &Shape| {
        let named = [4, 3, 1].into_iter().find(|&n| by_name(&shape.names, n).is_some());
        named.unwrap_or(shape.names.len().max(shape.counts[0]))
    };
    // Other devices may publish on the same topic.
    let first = joints.shapes().iter().take(SHAPES);
    match first.map(axes).max() {
        Some(1) => Mechanism::axis(Joint::Revolute),
        Some(3) => Mechanism::delta(false),
        _ => Mechanism::default(),
    }
}

/// Number of different messages from which the machine is inferred.
const SHAPES: usize = 100;

/// Joint states of a machine, axes in order.
struct Samples {
    /// Positions, efforts and velocities of each axis; no velocities unless every message has them.
    position: Vec<Vec<f64>>,
    effort: Vec<Vec<f64>>,
    velocity: Option<Vec<Vec<f64>>>,
    /// Stamp and log time of each state, ns.
    stamps: Vec<i64>,
    times: Vec<u64>,
    /// Number of each message on its topic, from 1; empty if there are no others.
    rows: Vec<u64>,
}

/// What is read of messages of one shape.
struct Picking {
    /// Place of each axis among the joints; `None` for another device.
    places: Option<Vec<usize>>,
    /// Whether the axes were taken in the order of the joints, and the number of joints beyond them.
    by_order: bool,
    extra: usize,
}

impl Picking {
    fn of(shape: &Shape, axes: usize, joint: Option<&str>) -> Self {
        let count = shape.names.len().max(shape.counts[0]);
        let named = match joint {
            Some(joint) => shape.names.iter().position(|n| n == joint).map(|place| vec![place]),
            None => by_name(&shape.names, axes),
        };
        let by_order = joint.is_none() && named.is_none() && count == axes;
        let places = if by_order { Some((0..axes).collect()) } else { named };
        let extra = if places.is_some() { count.saturating_sub(axes) } else { 0 };
        Self { places, by_order, extra }
    }
}

impl Samples {
    fn of(
        path: &Path,
        times: &[u64],
        joints: &States,
        machine: Mechanism,
        joint: Option<&str>,
        warnings: &mut Vec<String>,
    ) -> Result<Self, ReadError> {
        let axes = machine.axes();
        let pickings: Vec<Picking> = joints.shapes().iter().map(|shape| Picking::of(shape, axes, joint)).collect();
        let of_axes = || vec![Vec::with_capacity(joints.len()); axes];
        let mut out = Self {
            position: of_axes(),
            effort: of_axes(),
            velocity: joints.shapes().first().filter(|shape| shape.counts[1] > 0).map(|_| of_axes()),
            stamps: Vec::with_capacity(joints.len()),
            times: Vec::with_capacity(joints.len()),
            rows: Vec::new(),
        };
        let mut foreign: Option<&Shape> = None;
        for (i, time) in times.iter().enumerate() {
            let bad = |problem: &str| {
                let problem = format!("JointState message {} {problem}", i + 1);
                ReadError::content(path, problem, "position and effort of every joint")
            };
            let state = joints.get(i).ok_or_else(|| bad("cannot be decoded"))?;
            let Some(places) = &pickings[state.kind].places else {
                foreign = foreign.or(Some(state.shape));
                if out.rows.is_empty() {
                    out.rows = (1..=out.times.len() as u64).collect();
                }
                continue;
            };
            let most = places.iter().max().copied().unwrap_or(0);
            if state.position().len() <= most {
                return Err(bad("lacks positions"));
            }
            if state.effort().len() <= most {
                return Err(bad("lacks efforts (torques)"));
            }
            if state.velocity().len() <= most {
                out.velocity = None;
            }
            for (k, &place) in places.iter().enumerate() {
                out.position[k].push(state.position()[place]);
                out.effort[k].push(state.effort()[place]);
                if let Some(velocity) = &mut out.velocity {
                    velocity[k].push(state.velocity()[place]);
                }
            }
            if foreign.is_some() {
                out.rows.push(i as u64 + 1);
            }
            out.times.push(*time);
            out.stamps.push(state.stamp);
        }
        if let Some(shape) = foreign {
            let names = listed(&shape.names);
            if out.times.is_empty() {
                let problem = format!("has JointState messages with the joints {names}");
                let expected = match joint {
                    Some(joint) => format!("the joint {joint} (--joint)"),
                    None if axes == 1 => "the joint axis1; --joint NAME reads one of them as a lone axis".into(),
                    None => {
                        format!("the joints axis1…axis{axes}; --joint NAME reads one of them as a lone axis")
                    }
                };
                return Err(ReadError::content(path, problem, expected));
            }
            warnings.push(format!("JointState messages with the joints {names} ignored"));
        }
        let extra = pickings.iter().map(|p| p.extra).max().unwrap_or(0);
        if extra > 0 {
            let has = if axes == 1 { "one axis".into() } else { format!("{axes} axes") };
            warnings.push(format!("{extra} more joint(s) ignored: the machine has {has}"));
        }
        if let Some(by_order) = pickings.iter().rposition(|p| p.by_order) {
            let names = listed(&joints.shapes()[by_order].names);
            warnings.push(format!("joint names ({names}) are not axis1…axis{axes}: taken in this order"));
        }
        Ok(out)
    }

    /// Table of the joint states and of the accompanying topics, and the instant of t = 0, ns since 1970: `zero`, or
    /// that of the first sample.
    fn table(
        self,
        path: &Path,
        machine: Mechanism,
        zero: Option<i64>,
        content: &Content,
        warnings: &mut Vec<String>,
    ) -> (Table, i64) {
        let stamped = self.stamps.iter().all(|stamp| *stamp > 0);
        let first = if stamped { self.stamps.first().copied() } else { self.times.first().map(|&t| t as i64) };
        let zero = zero.or(first).unwrap_or(0);
        let seconds = |time: i64| time.wrapping_sub(zero) as f64 / 1e9;
        let t = match stamped {
            true => self.stamps.iter().map(|&stamp| seconds(stamp)).collect(),
            false => self.times.iter().map(|&time| seconds(time as i64)).collect(),
        };
        let mut columns = Vec::new();
        for stream in &content.streams {
            if let Messages::Rows(rows) = &stream.messages {
                columns.extend(self.beside(stream, rows, machine, warnings));
            }
        }
        let Self { position, effort, velocity, rows, .. } = self;
        let axis = |stem: &'static str, of: Vec<Vec<f64>>| {
            of.into_iter().enumerate().map(move |(k, values)| Column { name: format!("{stem}{}", k + 1), values })
        };
        let own = axis("q", position).chain(axis("tau", effort)).chain(axis("qd", velocity.unwrap_or_default()));
        columns.splice(0..0, own);
        (Table { file: path.into(), row: "JointState message", rows, t, timed: false, columns, machine }, zero)
    }

    /// Columns of a topic whose messages have the same times as the joint states.
    fn beside(&self, stream: &Stream, rows: &Rows, machine: Mechanism, warnings: &mut Vec<String>) -> Vec<Column> {
        let Some(places) = self.places(&stream.times) else {
            let reason = "not every joint state has a valid message of the same time";
            warnings.push(format!("`{}` ignored: {reason}", stream.topic));
            return Vec::new();
        };
        let mut columns = Vec::new();
        let channels = topics::channels(&stream.topic, machine).map(|(_, channel)| channel.to_string());
        for (k, name) in channels.enumerate().take(rows.width()) {
            if rows.present(k) == stream.times.len() {
                let values = places.iter().map(|&i| rows.value(i, k)).collect();
                columns.push(Column { name, values });
            } else if rows.present(k) > 0 {
                warnings.push(format!("`{name}` ignored: not in every message"));
            }
        }
        columns
    }

    /// For each joint state the index of the message of the same time, if each has one.
    fn places(&self, times: &[u64]) -> Option<Vec<usize>> {
        if *times == *self.times {
            return Some((0..times.len()).collect());
        }
        let by_time: HashMap<u64, usize> = times.iter().enumerate().map(|(i, time)| (*time, i)).collect();
        self.times.iter().map(|time| by_time.get(time).copied()).collect()
    }
}

/// The first names, for a message.
fn listed(names: &[String]) -> String {
    const TOLD: usize = 20;
    let more = names.len().saturating_sub(TOLD);
    let told = names.iter().take(TOLD).map(String::as_str).collect::<Vec<_>>().join(", ");
    told + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

/// Index of each axis among joints named `axis1`, `q1`, `joint1`, `joint_1`….
pub(super) fn by_name(names: &[String], axes: usize) -> Option<Vec<usize>> {
    let number = |name: &String| {
        let name: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        let name = name.to_ascii_lowercase();
        let number = ["axis", "joint", "q"].iter().find_map(|stem| name.strip_prefix(stem))?;
        number.parse::<usize>().ok()
    };
    let numbers: Vec<_> = names.iter().map(number).collect();
    (1..=axes).map(|k| numbers.iter().position(|n| *n == Some(k))).collect()
}
