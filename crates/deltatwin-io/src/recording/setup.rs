//! Setup of a run as TOML: the sidecar `<stem>.setup.toml` of a recording.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use deltatwin::machine::{Axis, Configuration, Effort, Joint, Mechanism, Payload, PerAxis, Setup, each, every_axis};
use serde::Deserialize;
use toml::Spanned;

use super::{Mapping, ReadError};
use crate::file::{self, WriteError};
use crate::load;
use crate::source::{Checked, Interval, Source};

/// Path of the sidecar of the recording `path`.
pub fn sidecar(path: &Path) -> PathBuf {
    path.with_extension("setup.toml")
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Document {
    configuration: State,
    payload: Load,
    load: load::Keys,
    noise: Noise,
    joint: Option<Spanned<String>>,
    arms: Option<Spanned<String>>,
    effort: Option<Spanned<String>>,
    columns: BTreeMap<String, Spanned<String>>,
    maps: Vec<Spanned<String>>,
}

/// Keys of the setup itself.
const OF_SETUP: [&str; 4] = ["configuration", "payload", "load", "noise"];

/// Content of a sidecar: setup of the run, and assignment of columns to channels.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sidecar {
    /// Setup of the run; `None` if the sidecar only says how the recording is read.
    pub setup: Option<Setup>,
    /// The machine of the recording, where its columns do not tell: a single axis by `joint` and `effort`, a robot on
    /// carriages by `arms`.
    pub machine: Option<Mechanism>,
    /// `[columns]`: channel = "column[unit]".
    pub columns: Mapping,
    /// `maps`: assignments that are applied after `columns`, in order.
    pub maps: Vec<Mapping>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
enum State {
    Assembled,
    Disassembled,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Load {
    mass: Spanned<f64>,
    com: [Spanned<f64>; 3],
    inertia_zz: Option<Spanned<f64>>,
    inertia: Option<Spanned<Vec<f64>>>,
    faces: Option<Spanned<[f64; 3]>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Noise {
    torque: Option<Spanned<Vec<Spanned<f64>>>>,
}

fn zero() -> Spanned<f64> {
    Spanned::new(0..0, 0.0)
}

impl Default for Document {
    fn default() -> Self {
        Self {
            configuration: State::Assembled,
            payload: Load::default(),
            load: load::Keys::default(),
            noise: Noise::default(),
            joint: None,
            arms: None,
            effort: None,
            columns: BTreeMap::new(),
            maps: Vec::new(),
        }
    }
}

impl Default for Load {
    fn default() -> Self {
        Self { mass: zero(), com: [zero(), zero(), zero()], inertia_zz: None, inertia: None, faces: None }
    }
}

/// Reads a setup file.
///
/// # Errors
/// If the file cannot be read; else the first error in it, with its position.
pub fn read(path: &Path) -> Result<Setup, ReadError> {
    Ok(Sidecar::read(path)?.setup.unwrap_or_default())
}

/// Reads a setup from TOML; `name` stands for the text in errors.
///
/// # Errors
/// The first error in the text, with its position.
pub fn from_toml(text: &str, name: &str) -> Result<Setup, ReadError> {
    Ok(Sidecar::from_toml(text, name)?.setup.unwrap_or_default())
}

impl Sidecar {
    /// Reads a setup file with its column assignments.
    ///
    /// # Errors
    /// If the file cannot be read; else the first error in it, with its position.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let text = file::text(path).map_err(|e| match e.kind() {
            std::io::ErrorKind::InvalidData => ReadError::content(path, "is not text", "a setup in TOML"),
            _ => ReadError::io(path, e),
        })?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads a setup with its column assignments from TOML; `name` stands for the text in errors.
    ///
    /// # Errors
    /// The first error in the text, with its position.
    pub fn from_toml(text: &str, name: &str) -> Result<Self, ReadError> {
        let source = Source::new(name, text);
        let document: Document = toml::from_str(text).map_err(|e| source.broken(&e))?;
        let keys: toml::Table = toml::from_str(text).map_err(|e| source.broken(&e))?;
        let setup = Setup {
            configuration: match document.configuration {
                State::Assembled => Configuration::Assembled,
                State::Disassembled => Configuration::Disassembled,
            },
            payload: payload(&source, &document.payload)?,
            load: load::read(&source, &document.load)?,
            torque_noise: torque_noise(&source, &document.noise)?,
        };
        let mut columns = Mapping::default();
        for (channel, column) in &document.columns {
            let refused = |e: String| source.problem(column.span(), format!("`columns.{channel}`: {e}"));
            columns.assign(channel, column.get_ref()).map_err(refused)?;
        }
        let map = |(k, text): (usize, &Spanned<String>)| {
            let refused = |e: String| source.problem(text.span(), format!("`maps[{k}]` is {:?}: {e}", text.get_ref()));
            text.get_ref().parse().map_err(refused)
        };
        let maps = document.maps.iter().enumerate().map(map).collect::<Result<_, _>>()?;
        let setup = OF_SETUP.iter().any(|key| keys.contains_key(*key)).then_some(setup);
        Ok(Self { setup, machine: machine(&source, &document)?, columns, maps })
    }

    /// All assignments in the order in which they are applied.
    pub fn assignments(&self) -> impl Iterator<Item = &Mapping> {
        Some(&self.columns).filter(|columns| !columns.is_empty()).into_iter().chain(&self.maps)
    }
}

/// The text of a sidecar with `maps` in place of its own; comments and everything else stay.
///
/// # Errors
/// The first error in the text, with its position; `name` stands for it.
pub fn with_maps(text: &str, maps: &[Mapping], name: &str) -> Result<String, ReadError> {
    Sidecar::from_toml(text, name)?;
    let broken = |e: toml_edit::TomlError| ReadError::content(Path::new(name), e.to_string(), "a setup in TOML");
    let mut document: toml_edit::DocumentMut = text.parse().map_err(broken)?;
    if maps.is_empty() {
        document.remove("maps");
    } else {
        let all: toml_edit::Array = maps.iter().map(Mapping::to_string).collect();
        document["maps"] = toml_edit::value(all);
    }
    Ok(document.to_string())
}

/// The text of a sidecar with the payload's `mass`, kg; comments and everything else stay. A sidecar that states no setup gets
/// the whole `setup` with this mass.
///
/// # Errors
/// The first error in the text, with its position; `name` stands for it.
pub fn with_payload_mass(text: &str, setup: &Setup, mass: f64, name: &str) -> Result<String, ReadError> {
    let own = Sidecar::from_toml(text, name)?;
    let broken = |e: toml_edit::TomlError| ReadError::content(Path::new(name), e.to_string(), "a setup in TOML");
    let mut document: toml_edit::DocumentMut = text.parse().map_err(broken)?;
    if own.setup.is_none() {
        let whole: toml_edit::DocumentMut = to_toml(setup).parse().map_err(broken)?;
        for (key, item) in whole.iter() {
            document[key] = item.clone();
        }
    }
    document["payload"]["mass"] = toml_edit::value(mass);
    Ok(document.to_string())
}

/// The machine that `arms`, or `joint` and `effort` describe; `None` without them.
fn machine(source: &Source, document: &Document) -> Checked<Option<Mechanism>> {
    let refused = |key: &str, value: &Spanned<String>, expected: &str| {
        source.problem(value.span(), format!("`{key}` is {:?}; expected {expected}", value.get_ref()))
    };
    let joint = |key: &str, value: &Option<Spanned<String>>| match value.as_ref().map(|v| (v, v.get_ref().as_str())) {
        None => Ok(None),
        Some((_, "revolute")) => Ok(Some(Joint::Revolute)),
        Some((_, "prismatic")) => Ok(Some(Joint::Prismatic)),
        Some((value, _)) => Err(refused(key, value, "\"revolute\" or \"prismatic\"")),
    };
    let (arms, lone) = (joint("arms", &document.arms)?, joint("joint", &document.joint)?);
    if let (Some(_), Some(value)) = (arms, document.joint.as_ref().or(document.effort.as_ref())) {
        let message = "`joint` and `effort` are of a single axis; expected none of them beside `arms`, a robot's";
        return Err(source.problem(value.span(), message.to_string()));
    }
    if lone.is_none() && document.effort.is_none() {
        return Ok((arms == Some(Joint::Prismatic)).then_some(Mechanism::LINEAR_DELTA));
    }
    let joint = lone.unwrap_or(Joint::Revolute);
    let effort = match &document.effort {
        None => Effort::Force,
        Some(value) => match value.get_ref().as_str() {
            "A" => Effort::Current,
            "N" | "Nm" | "N·m" => Effort::Force,
            _ => return Err(refused("effort", value, "\"A\", or the unit of torque or force")),
        },
    };
    Ok(Some(Mechanism::Axis(Axis { joint, effort })))
}

fn payload(source: &Source, load: &Load) -> Checked<Payload> {
    let mass = source.within("payload.mass", &load.mass, Interval(0.0, 100.0, "kg"))?;
    let vertical = source.maybe("payload.inertia_zz", &load.inertia_zz, Interval(0.0, 100.0, "kg·m²"))?;
    let mut com = [0.0; 3];
    for (own, c) in com.iter_mut().zip(&load.com) {
        *own = source.within("payload.com", c, Interval(-2.0, 2.0, "m"))?;
    }
    let mut payload = source.payload(mass, com, vertical, &load.inertia)?;
    if let Some(faces) = &load.faces {
        payload.faces = source.numbers("payload.faces", faces, Interval(0.0, 400.0, "m²"))?.into();
    }
    Ok(payload)
}

fn torque_noise(source: &Source, noise: &Noise) -> Checked<Option<PerAxis<f64>>> {
    let Some(values) = &noise.torque else { return Ok(None) };
    let mut sigma: PerAxis<f64> = each(0.0);
    let n = values.get_ref().len();
    let most = every_axis().len();
    if ![1, 3, most].contains(&n) {
        let message = format!("`noise.torque` has {n} numbers; expected one per axis: 1, 3 or {most}");
        return Err(source.problem(values.span(), message));
    }
    for (s, v) in sigma.iter_mut().zip(values.get_ref()) {
        *s = source.within("noise.torque", v, Interval(0.0, 1e4, "N·m"))?;
    }
    Ok(Some(sigma))
}

/// The setup as TOML, which [`from_toml`] reads back without loss.
pub fn to_toml(setup: &Setup) -> String {
    let configuration = match setup.configuration {
        Configuration::Assembled => "assembled",
        Configuration::Disassembled => "disassembled",
    };
    let mut text = format!("configuration = \"{configuration}\"\n\n{}", payload_to_toml(&setup.payload));
    text += &load::to_toml(&setup.load);
    if let Some(sigma) = setup.torque_noise {
        text += &format!("\n[noise]\ntorque = {sigma:?} # N·m, standard deviation\n");
    }
    text
}

/// The table `[payload]` of a setup or scenario, which reads back without loss.
pub(crate) fn payload_to_toml(payload: &Payload) -> String {
    let Payload { mass, com, .. } = payload;
    let mut text = format!(
        "[payload]\nmass = {mass:?} # kg\ncom = [{:?}, {:?}, {:?}] # m, from flange\n\
         inertia_zz = {:?} # kg·m², about the COM\n",
        com.x,
        com.y,
        com.z,
        payload.inertia_zz()
    );
    if payload.tensor != Payload::new(*mass, *com, payload.inertia_zz()).tensor {
        let [xx, yy, zz, xy, xz, yz] = payload.moments();
        let _ = writeln!(
            text,
            "inertia = [ # kg·m², about the COM\n    {xx:?}, {yy:?}, {zz:?}, # xx yy zz\n    {xy:?}, {xz:?}, {yz:?}, # xy xz yz\n]"
        );
    }
    let faces = &payload.faces;
    if faces.norm() > 0.0 {
        let _ = writeln!(text, "faces = [{:?}, {:?}, {:?}] # m², a box's across x, y, z", faces.x, faces.y, faces.z);
    }
    text
}

/// The sidecar of a CSV file of `machine` as TOML: the setup, and joints and effort of a machine that is not the usual
/// one.
pub(crate) fn sidecar_to_toml(setup: &Setup, machine: Mechanism) -> String {
    let mut text = String::new();
    if machine.joint() == Joint::Prismatic {
        text += match machine {
            Mechanism::Axis(_) => "joint = \"prismatic\" # q1 in m\n",
            Mechanism::Delta { .. } => "arms = \"prismatic\" # q1 to q3 in m, tau1 to tau3 in N\n",
        };
    }
    if machine.effort() == Effort::Current {
        text += "effort = \"A\" # tau1 is the motor's current: everything per torque constant\n";
    }
    text + &to_toml(setup)
}

/// Writes the sidecar of a CSV file.
///
/// # Errors
/// [`WriteError::Io`] if the file cannot be written.
pub(crate) fn write_beside(setup: &Setup, machine: Mechanism, path: &Path) -> Result<(), WriteError> {
    file::replace(path, |out| out.write_all(sidecar_to_toml(setup, machine).as_bytes()))
}

/// Writes a setup file.
///
/// # Errors
/// [`WriteError::Io`] if the file cannot be written.
pub fn write(setup: &Setup, path: &Path) -> Result<(), WriteError> {
    file::replace(path, |out| out.write_all(to_toml(setup).as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        from_toml(text, "run.setup.toml").unwrap_err().to_string()
    }

    #[test]
    fn the_mass_of_a_payload_is_set_and_everything_else_stays() {
        let text = "maps = [\"tau1=-tau1\"]\n[payload]\nmass = 1.0 # weighed\ncom = [0.0, 0.0, -0.1]\n";
        let changed = with_payload_mass(text, &Setup::default(), 2.5, "run.setup.toml").unwrap();
        let read = Sidecar::from_toml(&changed, "run.setup.toml").unwrap();
        let payload = read.setup.unwrap().payload;
        assert_eq!((payload.mass, payload.com.z, read.maps.len()), (2.5, -0.1, 1));
        // Of a sidecar that only says how the recording is read, and of none.
        let disassembled = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
        for text in ["maps = [\"tau1=-tau1\"]\n[columns]\nq1 = \"a\"\n", ""] {
            let changed = with_payload_mass(text, &disassembled, 2.5, "run.setup.toml").unwrap();
            let read = Sidecar::from_toml(&changed, "run.setup.toml").unwrap();
            let setup = read.setup.unwrap();
            assert_eq!((setup.payload.mass, setup.configuration), (2.5, Configuration::Disassembled), "{changed}");
            assert_eq!(read.columns.is_empty(), text.is_empty());
        }
    }

    #[test]
    fn round_trip() {
        let setup = Setup {
            configuration: Configuration::Disassembled,
            payload: Payload::new(1.0 / 3.0, [1e-7, -0.02, 0.1], 0.004),
            torque_noise: Some([0.4, 0.4, 0.4, 0.05]),
            ..Setup::default()
        };
        assert_eq!(from_toml(&to_toml(&setup), "x").unwrap(), setup);
        let box_ = Payload::cuboid(6.0, [0.4, 0.3, 0.2], [0.1, 0.0, 0.1]);
        let carrying = Setup { payload: box_, ..Setup::default() };
        assert_eq!(from_toml(&to_toml(&carrying), "x").unwrap(), carrying);
        let load = deltatwin::machine::Load { mass: 5.0, radius: Some(0.04), force: -3.0, torque: 1e-7 };
        let loaded = Setup { load, ..Setup::default() };
        assert_eq!(from_toml(&to_toml(&loaded), "x").unwrap(), loaded);
        assert_eq!(from_toml("", "x").unwrap(), Setup::default());
        assert_eq!(from_toml("[payload]\nmass = 2", "x").unwrap().payload.mass, 2.0);
    }

    #[test]
    fn a_tensor_is_read_and_checked() {
        let of = |keys: &str| from_toml(&format!("[payload]\nmass = 2\n{keys}"), "run.setup.toml");
        let tensor = [0.02, 0.04, 0.03, 0.0, -0.01, 0.001];
        let payload = of("inertia = [0.02, 0.04, 0.03, 0.0, -0.01, 0.001]").unwrap().payload;
        assert_eq!(payload, Payload::with_tensor(2.0, [0.0; 3], tensor));
        assert_eq!(of("inertia_zz = 0.03").unwrap().payload.moments(), [0.03, 0.03, 0.03, 0.0, 0.0, 0.0]);
        let e = of("inertia_zz = 0.03\ninertia = [0.02, 0.04, 0.05]").unwrap_err().to_string();
        assert!(e.starts_with("run.setup.toml:4:11: `payload.inertia` has zz = 0.05, but `inertia_zz` is 0.03"), "{e}");
        let e = of("inertia = [0.01, 0.01, 0.05]").unwrap_err().to_string();
        assert!(e.contains(":3:11: `payload.inertia` violates the triangle inequality"), "{e}");
        assert!(of("inertia = [0.01, nan, 0.05]").is_err());
    }

    #[test]
    fn maps_are_set_and_the_rest_stays() {
        let text = "# of Monday\nconfiguration = \"assembled\" # as usual\n\n[payload]\nmass = 2.0 # kg\n";
        let maps: Vec<Mapping> = ["tau1=-tau1, tau2=-tau2", "q1=q1+0.1"].map(|m| m.parse().unwrap()).into();
        let set = with_maps(text, &maps, "x").unwrap();
        let own = Sidecar::from_toml(&set, "x").unwrap();
        assert_eq!((&own.maps, own.setup.unwrap().payload.mass), (&maps, 2.0));
        assert!(set.starts_with("# of Monday\n") && set.ends_with("\n\n[payload]\nmass = 2.0 # kg\n"), "{set}");
        assert_eq!(with_maps(&set, &[], "x").unwrap(), text);
        // A sidecar that only says how a recording is read states no setup.
        let bare = with_maps("", &maps[..1], "x").unwrap();
        assert_eq!(Sidecar::from_toml(&bare, "x").unwrap(), Sidecar { maps: maps[..1].into(), ..Sidecar::default() });
        assert_eq!(with_maps(&bare, &[], "x").unwrap(), "");
        assert!(with_maps("[payload]\nmas = 1.0", &maps, "run.setup.toml").unwrap_err().to_string().contains(":2:1"));
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let e = refused("configuration = \"assembled\"\n[payload]\nmas = 1.0\n");
        assert!(e.starts_with("run.setup.toml:3:1: unknown key `payload.mas`"), "{e}");
        let e = refused("[payload]\nmass = -1.0\n");
        assert!(e.starts_with("run.setup.toml:2:8: `payload.mass` is -1; expected"), "{e}");
        assert!(refused("[payload]\ncom = [0.0, nan, 0.0]").contains(":2:13: `payload.com` is NaN"));
        assert!(refused("[noise]\ntorque = [1.0, 2.0]").contains(":2:"), "{}", refused("[noise]\ntorque = [1.0, 2.0]"));
        assert!(refused("configuration = \"asembled\"").contains("assembled"));
        assert!(refused("configuration = ").contains(":1:"));
        let e = refused("maps = [\"tau1=-tau1\", \"tau2=-tau2*\"]\n");
        assert!(e.starts_with("run.setup.toml:1:23: `maps[1]` is \"tau2=-tau2*\": `tau2=-tau2*`"), "{e}");
        assert!(refused("maps = \"tau1=-tau1\"").contains(":1:8: "), "{}", refused("maps = \"tau1=-tau1\""));
        let e = refused("[columns]\nt = \"Time[ms]\"\nq1 = \"Pos[furlong]\"\n");
        assert!(e.starts_with("run.setup.toml:3:6: `columns.q1`") && e.contains("furlong"), "{e}");
    }
}
