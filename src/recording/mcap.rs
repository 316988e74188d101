//! Recordings as MCAP: `/joint_states` as ROS 2 `sensor_msgs/msg/JointState`, the optional channels as JSON.
//!
//! Metadata `setup` holds the setup as TOML, `run` the time that counts as zero.

use std::collections::{BTreeMap, HashMap};
use std::io::Read;
use std::path::Path;

use mcap::records::{MessageHeader, Metadata, Record};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::{Deserialize, Serialize};

use super::check::{self, Column, Table};
use super::columns::{self, Mapping};
use super::{ReadError, Recording, Setup, Signals, WriteError, file};
use crate::model::{Joint, Mechanism, STRUTS};

const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Larger records and chunks are taken for damage, bytes.
const LARGEST_RECORD: usize = 256 << 20;
const EXPECTED: &str = "an MCAP file with sensor_msgs/msg/JointState messages";
/// Time zero of a written run, ns since 1970: 2023-11-14, a recognisable constant.
const EPOCH: i64 = 1_700_000_000 * SECOND;
const SECOND: i64 = 1_000_000_000;

const JOINTS: &str = "/joint_states";
const STRUT_FORCES: &str = "/strut_forces";
const END_EFFECTOR: &str = "/end_effector";
const ACCELERATION: &str = "/joint_acceleration";
const SOCKET_MARGINS: &str = "/socket_margins";

const JOINT_STATE: &str = "\
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
";

const STRUT_SCHEMA: &str = r#"{"title":"deltatwin.StrutForces","description":"axial force per strut, tension positive, N; null: not measured","type":"object","properties":{"upper":{"type":"array","items":{"type":["number","null"]},"minItems":6,"maxItems":6},"lower":{"type":"array","items":{"type":["number","null"]},"minItems":6,"maxItems":6}},"required":["upper","lower"]}"#;
const POINT_SCHEMA: &str = r#"{"title":"deltatwin.EndEffector","description":"centre of the platform's ball plane, m","type":"object","properties":{"x":{"type":"number"},"y":{"type":"number"},"z":{"type":"number"}},"required":["x","y","z"]}"#;
const ACCELERATION_SCHEMA: &str = r#"{"title":"deltatwin.JointAcceleration","description":"joint accelerations, rad/s²","type":"object","properties":{"acceleration":{"type":"array","items":{"type":"number"},"minItems":1,"maxItems":4}},"required":["acceleration"]}"#;

const MARGIN_SCHEMA: &str = r#"{"title":"deltatwin.SocketMargins","description":"what the ball socket at each end of a strut could still take, zero once open, N","type":"object","properties":{"upper":{"type":"array","items":{"type":"number"},"minItems":6,"maxItems":6},"lower":{"type":"array","items":{"type":"number"},"minItems":6,"maxItems":6}},"required":["upper","lower"]}"#;

#[derive(Serialize, Deserialize)]
struct StrutForces {
    upper: [Option<f64>; STRUTS],
    lower: [Option<f64>; STRUTS],
}

#[derive(Serialize, Deserialize)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Serialize, Deserialize)]
struct Acceleration {
    acceleration: Vec<f64>,
}

#[derive(Serialize, Deserialize)]
struct SocketMargins {
    upper: [f64; STRUTS],
    lower: [f64; STRUTS],
}

/// Whether `path` is an MCAP file by its first bytes or, when it has none, by its name.
pub fn is_mcap(path: &Path) -> bool {
    let named = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let mut start = [0; MAGIC.len()];
    let read = std::fs::File::open(path).and_then(|mut f| f.read_exact(&mut start));
    named || (read.is_ok() && start == MAGIC)
}

/// Writes a recording; times are rounded to nanoseconds.
pub fn write(path: &Path, recording: &Recording) -> Result<(), WriteError> {
    let signals = &recording.signals;
    check::columns(signals).map_err(|e| WriteError::invalid(path, e))?;
    if let Some(t) = signals.t.iter().find(|t| t.abs() >= 1e8) {
        return Err(WriteError::invalid(path, format!("time {t} s is out of range")));
    }
    file::replace(path, |out| {
        write_records(out, recording).map_err(|e| match e {
            mcap::McapError::Io(e) => e,
            other => std::io::Error::other(other),
        })
    })
}

fn write_records<W: std::io::Write + std::io::Seek>(out: W, recording: &Recording) -> mcap::McapResult<()> {
    let signals = &recording.signals;
    let mut w = mcap::WriteOptions::new()
        .profile("ros2")
        .library(concat!("deltatwin ", env!("CARGO_PKG_VERSION")))
        .compression(Some(mcap::Compression::Zstd))
        .chunk_size(Some(256 * 1024))
        .create(out)?;
    let metadata = |name: &str, key: &str, value: String| Metadata {
        name: name.into(),
        metadata: BTreeMap::from([(key.into(), value)]),
    };
    w.write_metadata(&metadata("setup", "toml", recording.setup.to_toml()))?;
    w.write_metadata(&metadata("run", "zero_ns", EPOCH.to_string()))?;
    w.write_metadata(&metadata("machine", "mechanism", mechanism_name(signals.mechanism).into()))?;

    let none = BTreeMap::new();
    let schema = w.add_schema("sensor_msgs/msg/JointState", "ros2msg", JOINT_STATE.as_bytes())?;
    let joints = w.add_channel(schema, JOINTS, "cdr", &none)?;
    let mut json = |present: bool, topic: &str, name: &str, text: &str| {
        if !present {
            return Ok(None);
        }
        let schema = w.add_schema(name, "jsonschema", text.as_bytes())?;
        w.add_channel(schema, topic, "json", &none).map(Some)
    };
    let any_strut = signals.strut_upper.iter().chain(&signals.strut_lower).any(Option::is_some);
    let struts = json(any_strut, STRUT_FORCES, "deltatwin.StrutForces", STRUT_SCHEMA)?;
    let point = json(signals.ee.is_some(), END_EFFECTOR, "deltatwin.EndEffector", POINT_SCHEMA)?;
    let name = "deltatwin.JointAcceleration";
    let acceleration = json(signals.qdd.is_some(), ACCELERATION, name, ACCELERATION_SCHEMA)?;
    let name = "deltatwin.SocketMargins";
    let margins = json(signals.socket_margin.is_some(), SOCKET_MARGINS, name, MARGIN_SCHEMA)?;

    let axes = signals.mechanism.axes();
    let mut second = None;
    for (i, t) in signals.t.iter().enumerate() {
        let time = EPOCH + (t * 1e9).round() as i64;
        if second.replace(time / SECOND).is_some_and(|s| s != time / SECOND) {
            w.flush()?;
        }
        let mut message = |channel_id: u16, data: &[u8]| {
            let (sequence, log_time) = (i as u32, time as u64);
            let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
            w.write_to_known_channel(&header, data)
        };
        // The joints come last: a sample whose joints arrived is complete.
        if let Some(id) = struts {
            let of = |f: &[Option<Vec<f64>>; STRUTS]| std::array::from_fn(|s| f[s].as_ref().map(|f| f[i]));
            let value = StrutForces { upper: of(&signals.strut_upper), lower: of(&signals.strut_lower) };
            message(id, &to_json(&value)?)?;
        }
        if let (Some(id), Some(ee)) = (point, &signals.ee) {
            let [x, y, z] = ee[i];
            message(id, &to_json(&Point { x, y, z })?)?;
        }
        if let (Some(id), Some(qdd)) = (acceleration, &signals.qdd) {
            message(id, &to_json(&Acceleration { acceleration: qdd[i][..axes].to_vec() })?)?;
        }
        if let (Some(id), Some(margin)) = (margins, &signals.socket_margin) {
            let of = |end: usize| std::array::from_fn(|s| margin[i][STRUTS * end + s]);
            message(id, &to_json(&SocketMargins { upper: of(0), lower: of(1) })?)?;
        }
        let mut cdr = CdrWriter::default();
        cdr.u32((time / SECOND) as u32);
        cdr.u32((time % SECOND) as u32);
        cdr.string("");
        cdr.u32(axes as u32);
        for k in 1..=axes {
            cdr.string(&format!("axis{k}"));
        }
        cdr.f64s(&signals.q[i][..axes]);
        cdr.f64s(signals.qd.as_ref().map_or(&[], |qd| &qd[i][..axes]));
        cdr.f64s(&signals.tau[i][..axes]);
        message(joints, &cdr.finish())?;
    }
    w.finish()?;
    Ok(())
}

fn to_json<T: Serialize>(value: &T) -> mcap::McapResult<Vec<u8>> {
    serde_json::to_vec(value).map_err(|e| mcap::McapError::Io(e.into()))
}

const MECHANISMS: [(&str, Mechanism); 4] = [
    ("delta", Mechanism::Delta { telescope: true }),
    ("delta without telescope", Mechanism::Delta { telescope: false }),
    ("revolute axis", Mechanism::Axis(Joint::Revolute)),
    ("prismatic axis", Mechanism::Axis(Joint::Prismatic)),
];

fn mechanism_name(mechanism: Mechanism) -> &'static str {
    MECHANISMS.iter().find(|(_, m)| *m == mechanism).map_or("", |(name, _)| name)
}

/// Reads and checks the signals of a machine, or of whatever machine the file tells, and the setup if it holds one.
///
/// A file that was cut short is read up to its last complete chunk. Also returns what was noticed and repaired.
pub fn read(
    path: &Path,
    machine: Option<Mechanism>,
    maps: &[Mapping],
) -> Result<(Signals, Option<Setup>, Vec<String>), ReadError> {
    let content = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
    if content.is_empty() {
        return Err(ReadError::content(path, "is empty", EXPECTED));
    }
    if !content.starts_with(MAGIC) {
        return Err(ReadError::content(path, "is not an MCAP file", EXPECTED));
    }
    let mut warnings = Vec::new();
    let messages = collect(path, &content, &mut warnings)?;
    let setup = match messages.metadata.get("setup").and_then(|m| m.get("toml")) {
        Some(text) => Some(Setup::from_toml(text, &format!("{}[setup]", path.display()))?),
        None => None,
    };
    let machine = machine.unwrap_or_else(|| messages.machine());
    let (table, mapped) = columns::remap(joints(path, &messages, machine, &mut warnings)?, maps)?;
    let (signals, noticed) = check::signals(table)?;
    warnings.extend(mapped.into_iter().chain(noticed));
    Ok((signals, setup, warnings))
}

/// Messages worth reading, in the order of the file.
#[derive(Default)]
struct Messages {
    metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Log time and CDR data of the joint states.
    joints: Vec<(u64, Vec<u8>)>,
    /// JSON data by topic and log time.
    json: BTreeMap<&'static str, HashMap<u64, Vec<u8>>>,
}

impl Messages {
    /// The machine that is noted in the file, or else the one with as many axes as there are joints.
    fn machine(&self) -> Mechanism {
        let noted = self.metadata.get("machine").and_then(|m| m.get("mechanism"));
        if let Some((_, known)) = noted.and_then(|n| MECHANISMS.iter().find(|(name, _)| name == n)) {
            return *known;
        }
        let states = self.joints.iter().filter_map(|(_, data)| JointState::parse(data));
        let axes = |s: JointState| {
            let named = [4, 3, 1].into_iter().find(|&n| by_name(&s.name, n).is_some());
            named.unwrap_or(s.name.len().max(s.position.len()))
        };
        // Other devices may publish on the same topic.
        match states.take(100).map(axes).max() {
            Some(1) => Mechanism::Axis(Joint::Revolute),
            Some(3) => Mechanism::Delta { telescope: false },
            _ => Mechanism::default(),
        }
    }
}

/// The records of a file, with those inside chunks.
struct Records<'a> {
    rest: &'a [u8],
    reader: LinearReader,
}

impl<'a> Records<'a> {
    fn new(content: &'a [u8]) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_RECORD);
        Self { rest: content, reader: LinearReader::new_with_options(options) }
    }
}

impl Iterator for Records<'_> {
    type Item = mcap::McapResult<Record<'static>>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let (now, rest) = self.rest.split_at(wanted.min(self.rest.len()));
                    self.reader.insert(now.len()).copy_from_slice(now);
                    self.reader.notify_read(now.len());
                    self.rest = rest;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    return Some(mcap::read::parse_record(opcode, data).map(Record::into_owned));
                }
                Err(e) => return Some(Err(e)),
            }
        }
    }
}

/// What a channel is to us.
#[derive(Clone, Copy, PartialEq)]
enum Use {
    Joints,
    Json(&'static str),
}

fn collect(path: &Path, content: &[u8], warnings: &mut Vec<String>) -> Result<Messages, ReadError> {
    let mut found = Messages::default();
    let mut schemas: HashMap<u16, String> = HashMap::new();
    let mut channels: HashMap<u16, Use> = HashMap::new();
    let mut topics: Vec<String> = Vec::new();
    let mut states: BTreeMap<u16, Vec<(u64, Vec<u8>)>> = BTreeMap::new();
    let mut state_topics: BTreeMap<u16, String> = BTreeMap::new();
    let mut unread = None;
    let mut ended = false;

    for record in Records::new(content) {
        let record = match record {
            Ok(record) => record,
            Err(e) => {
                if !ended {
                    warnings.push(format!("file is cut short or damaged: {e}"));
                }
                ended = true;
                break;
            }
        };
        match record {
            Record::Schema { header, .. } => {
                schemas.insert(header.id, header.name);
            }
            Record::Channel(c) => {
                let schema = schemas.get(&c.schema_id).map_or("", String::as_str);
                let is_state = matches!(schema, "sensor_msgs/msg/JointState" | "sensor_msgs/JointState");
                let json = [STRUT_FORCES, END_EFFECTOR, ACCELERATION, SOCKET_MARGINS];
                if is_state && c.message_encoding == "cdr" {
                    channels.insert(c.id, Use::Joints);
                    state_topics.insert(c.id, c.topic.clone());
                } else if is_state {
                    unread = Some(c.message_encoding.clone());
                } else if let Some(topic) = json.into_iter().find(|t| *t == c.topic)
                    && c.message_encoding == "json"
                {
                    channels.insert(c.id, Use::Json(topic));
                }
                if !topics.contains(&c.topic) {
                    topics.push(c.topic);
                }
            }
            Record::Message { header, data } => match channels.get(&header.channel_id) {
                Some(Use::Joints) => {
                    let list = states.entry(header.channel_id).or_default();
                    list.push((header.log_time, data.into_owned()));
                }
                Some(Use::Json(topic)) => {
                    let map = found.json.entry(topic).or_default();
                    map.insert(header.log_time, data.into_owned());
                }
                None => {}
            },
            Record::Metadata(m) => {
                found.metadata.insert(m.name, m.metadata);
            }
            Record::DataEnd(_) => ended = true,
            _ => {}
        }
    }
    if !ended {
        warnings.push("file is cut short: it ends without a footer".into());
    }
    let usual = |id: &u16| state_topics.get(id).is_some_and(|t| t == JOINTS);
    let chosen = states.keys().find(|id| usual(id)).or_else(|| states.keys().next()).copied();
    let Some(id) = chosen else {
        let problem = match unread {
            Some(encoding) => format!("has JointState messages in the encoding `{encoding}`"),
            None if !state_topics.is_empty() => "has a JointState topic without messages".into(),
            None => format!("has no JointState messages (topics: {})", topics.join(", ")),
        };
        let cut = if warnings.is_empty() { "" } else { " and is cut short" };
        return Err(ReadError::content(path, problem + cut, format!("{EXPECTED} in CDR")));
    };
    if states.len() > 1 {
        let topic = state_topics.get(&id).map_or("", String::as_str);
        warnings.push(format!("several topics carry JointState; `{topic}` is read"));
    }
    found.joints = states.remove(&id).unwrap_or_default();
    Ok(found)
}

/// Values of an optional channel at one time; those that were not measured are missing.
type Sample = Vec<Option<f64>>;

/// Columns of the joint states and of the channels that go with them.
fn joints(
    path: &Path,
    messages: &Messages,
    machine: Mechanism,
    warnings: &mut Vec<String>,
) -> Result<Table, ReadError> {
    let axes = machine.axes();
    let mut extra = 0;
    let mut order: Option<(Vec<String>, Option<Vec<usize>>)> = None;
    let mut used = Vec::new();
    let mut rows = Vec::new();
    let mut states: Vec<JointState> = Vec::new();
    let mut by_order = false;
    let mut foreign = None;
    for (i, (log_time, data)) in messages.joints.iter().enumerate() {
        let bad = |problem: &str| {
            let problem = format!("JointState message {} {problem}", i + 1);
            ReadError::content(path, problem, "position and effort of every joint")
        };
        let state = JointState::parse(data).ok_or_else(|| bad("cannot be decoded"))?;
        if order.as_ref().is_none_or(|(names, _)| *names != state.name) {
            let mut found = by_name(&state.name, axes);
            let count = state.name.len().max(state.position.len());
            if found.is_none() && count == axes {
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
        states.push(JointState {
            position: pick(&state.position),
            velocity: pick(&state.velocity),
            effort: pick(&state.effort),
            ..state
        });
        rows.push(i as u64 + 1);
        used.push(*log_time);
    }
    if let Some(names) = foreign {
        let names = names.join(", ");
        if states.is_empty() {
            let problem = format!("has JointState messages with the joints {names}");
            let expected = if axes == 1 { "the joint axis1".into() } else { format!("the joints axis1…axis{axes}") };
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

    let stamped = states.iter().all(|s| s.stamp > 0);
    let times: Vec<i64> =
        if stamped { states.iter().map(|s| s.stamp).collect() } else { used.iter().map(|&t| t as i64).collect() };
    let zero = messages.metadata.get("run").and_then(|m| m.get("zero_ns")?.parse::<i64>().ok());
    let zero = zero.or(times.first().copied()).unwrap_or(0);
    let t = times.iter().map(|&t| t.wrapping_sub(zero) as f64 / 1e9).collect();

    let mut columns = Vec::new();
    let mut axis = |stem: &str, of: &dyn Fn(&JointState) -> &Vec<f64>| {
        if states.iter().all(|s| of(s).len() == axes) {
            for k in 0..axes {
                let values = states.iter().map(|s| of(s)[k]).collect();
                columns.push(Column { name: format!("{stem}{}", k + 1), values });
            }
        }
    };
    axis("q", &|s| &s.position);
    axis("tau", &|s| &s.effort);
    axis("qd", &|s| &s.velocity);

    let names = |end| (1..=STRUTS).map(move |s| format!("strut{s}_{end}"));
    let strut_names: Vec<String> = names("upper").chain(names("lower")).collect();
    let ee_names = ["ee_x", "ee_y", "ee_z"].map(String::from);
    let qdd_names: Vec<String> = (1..=axes).map(|k| format!("qdd{k}")).collect();
    let mut extra = |topic: &str, names: &[String], parse: &dyn Fn(&[u8]) -> Option<Sample>| {
        let Some(by_time) = messages.json.get(topic) else {
            return;
        };
        let samples: Option<Vec<_>> = used.iter().map(|time| parse(by_time.get(time)?)).collect();
        let Some(samples) = samples else {
            let reason = "not every joint state has a valid message of the same time";
            warnings.push(format!("`{topic}` ignored: {reason}"));
            return;
        };
        for (k, name) in names.iter().enumerate() {
            let values: Vec<f64> = samples.iter().filter_map(|s| *s.get(k)?).collect();
            if values.len() == used.len() {
                columns.push(Column { name: name.clone(), values });
            } else if !values.is_empty() {
                warnings.push(format!("`{name}` ignored: not in every message"));
            }
        }
    };
    extra(STRUT_FORCES, &strut_names, &|data| {
        let forces: StrutForces = serde_json::from_slice(data).ok()?;
        Some([forces.upper, forces.lower].concat())
    });
    extra(END_EFFECTOR, &ee_names, &|data| {
        let p: Point = serde_json::from_slice(data).ok()?;
        Some(vec![Some(p.x), Some(p.y), Some(p.z)])
    });
    extra(ACCELERATION, &qdd_names, &|data| {
        let a: Acceleration = serde_json::from_slice(data).ok()?;
        Some(a.acceleration.into_iter().map(Some).collect())
    });
    extra(SOCKET_MARGINS, &check::margin_names(), &|data| {
        let m: SocketMargins = serde_json::from_slice(data).ok()?;
        Some([m.upper, m.lower].concat().into_iter().map(Some).collect())
    });
    Ok(Table { file: path.into(), row: "JointState message", rows, t, columns, machine })
}

/// Place of each axis among joints called `axis1`, `q1`, `joint1`, `joint_1`….
fn by_name(names: &[String], axes: usize) -> Option<Vec<usize>> {
    let number = |name: &String| {
        let name: String = name.chars().filter(char::is_ascii_alphanumeric).collect();
        let name = name.to_ascii_lowercase();
        let number = ["axis", "joint", "q"].iter().find_map(|stem| name.strip_prefix(stem))?;
        number.parse::<usize>().ok()
    };
    let numbers: Vec<_> = names.iter().map(number).collect();
    (1..=axes).map(|k| numbers.iter().position(|n| *n == Some(k))).collect()
}

/// One `sensor_msgs/msg/JointState`.
struct JointState {
    /// ns since 1970.
    stamp: i64,
    name: Vec<String>,
    position: Vec<f64>,
    velocity: Vec<f64>,
    effort: Vec<f64>,
}

impl JointState {
    fn parse(data: &[u8]) -> Option<Self> {
        let mut r = CdrReader::new(data)?;
        let (sec, nanosec) = (r.u32()? as i32, r.u32()?);
        let stamp = i64::from(sec) * SECOND + i64::from(nanosec);
        r.string()?;
        let n = r.u32()?;
        let mut name = Vec::new();
        for _ in 0..n {
            name.push(r.string()?);
        }
        Some(Self { stamp, name, position: r.f64s()?, velocity: r.f64s()?, effort: r.f64s()? })
    }
}

/// Little-endian CDR; alignment counts from after the header.
#[derive(Default)]
struct CdrWriter(Vec<u8>);

impl CdrWriter {
    fn align(&mut self, n: usize) {
        self.0.resize(self.0.len().next_multiple_of(n), 0);
    }

    fn u32(&mut self, v: u32) {
        self.align(4);
        self.0.extend(v.to_le_bytes());
    }

    fn string(&mut self, s: &str) {
        self.u32(s.len() as u32 + 1);
        self.0.extend(s.as_bytes());
        self.0.push(0);
    }

    fn f64s(&mut self, v: &[f64]) {
        self.u32(v.len() as u32);
        for x in v {
            self.align(8);
            self.0.extend(x.to_le_bytes());
        }
    }

    fn finish(self) -> Vec<u8> {
        [&[0, 1, 0, 0], &self.0[..]].concat()
    }
}

/// CDR of either byte order.
struct CdrReader<'a> {
    data: &'a [u8],
    at: usize,
    little: bool,
}

impl<'a> CdrReader<'a> {
    fn new(data: &'a [u8]) -> Option<Self> {
        let (header, data) = data.split_at_checked(4)?;
        let little = match header[..2] {
            [0, 0] => false,
            [0, 1] => true,
            _ => return None,
        };
        Some(Self { data, at: 0, little })
    }

    fn take(&mut self, n: usize, align: usize) -> Option<&'a [u8]> {
        let start = self.at.checked_next_multiple_of(align)?;
        let bytes = self.data.get(start..start.checked_add(n)?)?;
        self.at = start + n;
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = self.take(4, 4)?.try_into().ok()?;
        Some(if self.little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    fn string(&mut self) -> Option<String> {
        let n = self.u32()? as usize;
        let bytes = self.take(n, 1)?;
        let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        Some(String::from_utf8_lossy(text).into_owned())
    }

    fn f64s(&mut self) -> Option<Vec<f64>> {
        let n = self.u32()?;
        let mut values = Vec::new();
        for _ in 0..n {
            let bytes = self.take(8, 8)?.try_into().ok()?;
            let little = self.little;
            values.push(if little { f64::from_le_bytes(bytes) } else { f64::from_be_bytes(bytes) });
        }
        Some(values)
    }
}
