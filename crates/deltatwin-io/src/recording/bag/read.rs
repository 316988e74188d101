//! Conversion of a bag's messages to checked signals.

use std::collections::HashMap;
use std::path::Path;

use deltatwin::machine::{Joint, Mechanism, Setup};
use deltatwin::recording::Signals;

use super::content::{Content, Encoding, Stream};
use super::messages::JointState;
use super::{EPOCH, EXPECTED, MECHANISMS, folder, read_file, topics};
use crate::recording::check::{self, Column, Table};
use crate::recording::columns;
use crate::recording::{ReadError, Reading, setup};

/// Signals of a bag, its setup if it contains one, and warnings about what was repaired.
///
/// `path` is an MCAP or SQLite file, or a bag folder; a truncated file is read up to its last complete chunk.
/// `how.machine` is the expected machine; `None` means the one stated in the bag or inferred from its joints, or a
/// single axis if `how.joint` names one of several. `how.maps` assign columns to channels.
///
/// # Errors
/// A [`ReadError`] if a file cannot be read, the bag contains no usable joint states, or the signals fail the checks.
pub fn read(path: &Path, how: &Reading) -> Result<(Signals, Option<Setup>, Vec<String>), ReadError> {
    let mut warnings = Vec::new();
    let mut content = if path.is_dir() { folder::read(path, &mut warnings)? } else { read_file(path, &mut warnings)? };
    let setup = match content.metadata.get("setup").and_then(|m| m.get("toml")) {
        Some(text) => Some(setup::from_toml(text, &format!("{}[setup]", path.display()))?),
        None => None,
    };
    let joints = joint_states(path, &mut content, &mut warnings)?;
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
    let samples = Samples::of(path, &joints, machine, how.joint, &mut warnings)?;
    let zero = content.metadata.get("run").and_then(|m| m.get("zero_ns")?.parse::<i64>().ok());
    let (table, start) = samples.table(path, machine, zero, &content, &mut warnings);
    let (table, mapped) = columns::remap(table, how)?;
    let (mut signals, noticed) = check::signals(table)?;
    signals.start = Some(start).filter(|s| *s != EPOCH);
    warnings.extend(mapped.into_iter().chain(noticed));
    Ok((signals, setup, warnings))
}

/// Removes and returns the stream with the robot's joint states.
fn joint_states(path: &Path, content: &mut Content, warnings: &mut Vec<String>) -> Result<Stream, ReadError> {
    let is_state = |s: &Stream| !topics::is_optional(&s.topic) && s.encoding == Encoding::Cdr;
    let filled: Vec<usize> = (0..content.streams.len())
        .filter(|&i| is_state(&content.streams[i]) && !content.streams[i].messages.is_empty())
        .collect();
    let usual = filled.iter().find(|&&i| content.streams[i].topic == topics::JOINTS);
    let Some(&chosen) = usual.or(filled.first()) else {
        let problem = match &content.unread {
            Some(encoding) => format!("has JointState messages in the encoding `{encoding}`"),
            None if content.streams.iter().any(is_state) => "has a JointState topic without messages".into(),
            None => format!("has no JointState messages (topics: {})", content.topics.join(", ")),
        };
        let cut = if content.cut { " and is cut short" } else { "" };
        return Err(ReadError::content(path, problem + cut, format!("{EXPECTED} in CDR")));
    };
    if filled.len() > 1 {
        let topic = &content.streams[chosen].topic;
        warnings.push(format!("several topics carry JointState; `{topic}` is read"));
    }
    Ok(content.streams.swap_remove(chosen))
}

/// The machine stated in the bag, if any.
fn noted_machine(content: &Content) -> Option<Mechanism> {
    let noted = content.metadata.get("machine")?.get("mechanism")?;
    MECHANISMS.iter().find(|(name, _)| name == noted).map(|(_, machine)| *machine)
}

/// The machine with as many axes as there are joints.
fn machine_of(joints: &Stream) -> Mechanism {
    let states = joints.messages.iter().filter_map(|(_, data)| JointState::parse(data));
    let axes = |s: JointState| {
        let named = [4, 3, 1].into_iter().find(|&n| by_name(&s.name, n).is_some());
        named.unwrap_or(s.name.len().max(s.position.len()))
    };
    // Other devices may publish on the same topic.
    match states.take(100).map(axes).max() {
        Some(1) => Mechanism::axis(Joint::Revolute),
        Some(3) => Mechanism::Delta { telescope: false },
        _ => Mechanism::default(),
    }
}

/// Joint states of a machine, axes in order.
struct Samples {
    states: Vec<JointState>,
    /// Log time of each state, ns.
    times: Vec<u64>,
    /// Number of each message on its topic, from 1.
    rows: Vec<u64>,
}

impl Samples {
    fn of(
        path: &Path,
        joints: &Stream,
        machine: Mechanism,
        joint: Option<&str>,
        warnings: &mut Vec<String>,
    ) -> Result<Self, ReadError> {
        let axes = machine.axes();
        let mut extra = 0;
        let mut order: Option<(Vec<String>, Option<Vec<usize>>)> = None;
        let mut out = Self { states: Vec::new(), times: Vec::new(), rows: Vec::new() };
        let mut by_order = false;
        let mut foreign = None;
        for (i, (log_time, data)) in joints.messages.iter().enumerate() {
            let bad = |problem: &str| {
                let problem = format!("JointState message {} {problem}", i + 1);
                ReadError::content(path, problem, "position and effort of every joint")
            };
            let state = JointState::parse(data).ok_or_else(|| bad("cannot be decoded"))?;
            if order.as_ref().is_none_or(|(names, _)| *names != state.name) {
                let chosen = joint.map(|j| state.name.iter().position(|n| n == j).map(|place| vec![place]));
                let mut found = chosen.clone().unwrap_or_else(|| by_name(&state.name, axes));
                let count = state.name.len().max(state.position.len());
                if chosen.is_none() && found.is_none() && count == axes {
                    found = Some((0..axes).collect());
                    by_order = true;
                }
                if found.is_some() {
                    extra = extra.max(count - axes);
                }
                order = Some((state.name.clone(), found));
            }
            let Some((_, Some(picked))) = &order else {
                foreign = foreign.or(Some(state.name));
                continue;
            };
            let most = picked.iter().max().copied().unwrap_or(0);
            if state.position.len() <= most {
                return Err(bad("lacks positions"));
            }
            if state.effort.len() <= most {
                return Err(bad("lacks efforts (torques)"));
            }
            let pick = |v: &[f64]| picked.iter().filter_map(|&j| v.get(j).copied()).collect();
            out.states.push(JointState {
                position: pick(&state.position),
                velocity: pick(&state.velocity),
                effort: pick(&state.effort),
                ..state
            });
            out.rows.push(i as u64 + 1);
            out.times.push(*log_time);
        }
        if let Some(names) = foreign {
            let names = names.join(", ");
            if out.states.is_empty() {
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
        if extra > 0 {
            let has = if axes == 1 { "one axis".into() } else { format!("{axes} axes") };
            warnings.push(format!("{extra} more joint(s) ignored: the machine has {has}"));
        }
        if by_order {
            let names = order.map(|o| o.0.join(", ")).unwrap_or_default();
            warnings.push(format!("joint names ({names}) are not axis1…axis{axes}: taken in this order"));
        }
        Ok(out)
    }

    /// Table of the joint states and of the accompanying topics, and the instant of t = 0, ns since 1970: `zero`, or
    /// that of the first sample.
    fn table(
        &self,
        path: &Path,
        machine: Mechanism,
        zero: Option<i64>,
        content: &Content,
        warnings: &mut Vec<String>,
    ) -> (Table, i64) {
        let stamped = self.states.iter().all(|s| s.stamp > 0);
        let times: Vec<i64> = match stamped {
            true => self.states.iter().map(|s| s.stamp).collect(),
            false => self.times.iter().map(|&t| t as i64).collect(),
        };
        let zero = zero.or(times.first().copied()).unwrap_or(0);
        let t = times.iter().map(|&t| t.wrapping_sub(zero) as f64 / 1e9).collect();
        let axes = machine.axes();
        let mut columns = Vec::new();
        let mut axis = |stem: &str, of: &dyn Fn(&JointState) -> &Vec<f64>| {
            if self.states.iter().all(|s| of(s).len() == axes) {
                for k in 0..axes {
                    let values = self.states.iter().map(|s| of(s)[k]).collect();
                    columns.push(Column { name: format!("{stem}{}", k + 1), values });
                }
            }
        };
        axis("q", &|s| &s.position);
        axis("tau", &|s| &s.effort);
        axis("qd", &|s| &s.velocity);
        for stream in content.streams.iter().filter(|s| topics::is_optional(&s.topic)) {
            columns.extend(self.beside(stream, axes, warnings));
        }
        (Table { file: path.into(), row: "JointState message", rows: self.rows.clone(), t, columns, machine }, zero)
    }

    /// Columns of a topic whose messages have the same times as the joint states.
    fn beside(&self, stream: &Stream, axes: usize, warnings: &mut Vec<String>) -> Vec<Column> {
        let names = topics::columns(&stream.topic, axes);
        let by_time: HashMap<u64, &Vec<u8>> = stream.messages.iter().map(|(time, data)| (*time, data)).collect();
        let decode = |time| topics::decode(&stream.topic, stream.encoding, &names, by_time.get(time)?);
        let Some(samples) = self.times.iter().map(decode).collect::<Option<Vec<_>>>() else {
            let reason = "not every joint state has a valid message of the same time";
            warnings.push(format!("`{}` ignored: {reason}", stream.topic));
            return Vec::new();
        };
        let mut columns = Vec::new();
        for (k, name) in names.into_iter().enumerate() {
            let values: Vec<f64> = samples.iter().filter_map(|s| *s.get(k)?).collect();
            if values.len() == self.times.len() {
                columns.push(Column { name, values });
            } else if !values.is_empty() {
                warnings.push(format!("`{name}` ignored: not in every message"));
            }
        }
        columns
    }
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
