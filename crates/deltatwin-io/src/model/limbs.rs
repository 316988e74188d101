//! `[[limbs]]`, `[plate]` and `[coupling]`: a parallel robot described limb by limb.

use deltatwin::dynamics::ChannelMap;
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::machine::{Actuator, Geometry, Limb, Mechanism, Plate, Unit, every_limb};
use deltatwin::recording::Channel;
use nalgebra::Vector3;
use toml::de::DeValue;
use toml_edit::{Array, ArrayOfTables, Item, Table as Edited, value};

use super::schema::{Bounds, LIMB, Shape};
use super::table::{Table, keys};
use crate::source::Checked;

const PLATES: &str = "\"rigid\", \"par4\", \"h4\" or \"i4\"";
const LENGTH: Bounds = Bounds::between(-10.0, 10.0);
const TURN: Bounds = Bounds::between(-std::f64::consts::TAU, std::f64::consts::TAU);
const M: Option<&str> = Some("m");

/// Reads limbs and plate; heights are zero.
///
/// # Errors
/// The first value that is missing, not allowed, or contradicts another one.
pub(super) fn read(top: &Table) -> Checked<Geometry> {
    const EXPECTED: &str = "tables [[limbs]], one per limb, the driven ones first";
    let plate = read_plate(top)?;
    let list = top.required("limbs", EXPECTED)?;
    let DeValue::Array(items) = list.get_ref() else { return Err(top.wrong_type("limbs", list, EXPECTED)) };
    let mut limbs = Vec::new();
    for (i, item) in items.iter().enumerate() {
        let Some(entries) = item.get_ref().as_table() else { return Err(top.wrong_type("limbs", item, EXPECTED)) };
        let path = format!("limbs {}", i + 1);
        limbs.push(read_limb(&Table { source: top.source, path, span: item.span(), entries }, &plate)?);
    }
    let most = every_limb().len();
    let joint = |limb: &Limb| limb.actuator.joint();
    let why = match &limbs[..] {
        _ if !(3..=most).contains(&limbs.len()) => Some(format!("expected 3 to {most} limbs")),
        all if all.windows(2).any(|w| joint(&w[0]) != joint(&w[1])) => {
            Some("expected shafts on all limbs, or an `inclination` on all of them".into())
        }
        all if all.windows(2).any(|w| w[1].driven && !w[0].driven) => {
            Some("expected the limbs with a drive first: axis k is limb k".into())
        }
        _ => None,
    };
    if let Some(why) = why {
        return Err(top.refuse("limbs", &why));
    }
    check_coupling(top, &limbs)?;
    let geometry = Geometry::new(&limbs, plate);
    if geometry.is_regular() {
        let why = "three equal limbs at thirds of a turn; expected `mechanism = \"delta\"`, which describes them in [geometry]";
        return Err(top.refuse("mechanism", why));
    }
    Ok(geometry)
}

fn read_limb(table: &Table, plate: &Plate) -> Checked<Limb> {
    table.only(&[&keys(LIMB)[..], &["inclination", "part", "drive"]].concat())?;
    let mut limb = Limb::at(0.0);
    table.fill(LIMB, &mut limb, true, Mechanism::default())?;
    if table.entry("inclination").is_some() {
        let inclination = table.numbers("inclination", Shape::One, &TURN, Some(Unit::Rad))?[0];
        limb.actuator = Actuator::Prismatic { inclination };
    } else if limb.arm_length == 0.0 {
        return Err(table.refuse("arm_length", "expected a length above 0 m of an arm that turns"));
    }
    if table.entry("part").is_some() {
        let bounds = Bounds { integer: true, ..Bounds::between(1.0, plate.carriers() as f64) };
        limb.part = table.numbers("part", Shape::One, &bounds, None::<Unit>)?[0] as usize - 1;
    }
    limb.driven = table.optional_boolean("drive")?.unwrap_or(true);
    let [low, high] = limb.limits;
    if low >= high || !(low..=high).contains(&0.0) {
        return Err(table.refuse("limits", "expected the smallest value, then the largest, and 0 between them"));
    }
    Ok(limb)
}

fn read_plate(top: &Table) -> Checked<Plate> {
    let Some(table) = top.optional_table("plate")? else { return Ok(Plate::Rigid) };
    let vector = |key: &str| Ok(Vector3::from_column_slice(&table.numbers(key, Shape::Array(3), &LENGTH, M)?));
    let (own, plate): (&[&str], _) = match table.string("kind", PLATES)? {
        "rigid" => (&[], Plate::Rigid),
        "par4" => {
            let plate = Plate::Par4 { main: vector("main")?, connecting: vector("connecting")? };
            (&["main", "connecting"], plate)
        }
        "h4" => (&["hinge1", "hinge2"], Plate::H4 { hinges: [vector("hinge1")?, vector("hinge2")?] }),
        "i4" => {
            let azimuth = table.numbers("azimuth", Shape::One, &TURN, Some(Unit::Rad))?[0];
            let bounds = Bounds { above: true, ..Bounds::between(0.0, 10.0) };
            let radius = table.numbers("radius", Shape::One, &bounds, M)?[0];
            (&["azimuth", "radius"], Plate::I4 { azimuth, radius })
        }
        _ => return Err(table.refuse("kind", &format!("expected {PLATES}, the plates known"))),
    };
    table.only(&[&["kind"], own].concat())?;
    for key in own.iter().filter(|key| ["main", "connecting", "hinge1", "hinge2"].contains(key)) {
        let v = vector(key)?;
        if v.z != 0.0 || v.norm() == 0.0 {
            return Err(table.refuse(key, "expected a horizontal vector, its z zero, longer than 0 m"));
        }
    }
    Ok(plate)
}

/// Checks that `[coupling]` joins the passive limbs.
fn check_coupling(top: &Table, limbs: &[Limb]) -> Checked<()> {
    let passive: Vec<f64> = (1..).zip(limbs).filter(|(_, limb)| !limb.driven).map(|(i, _)| f64::from(i)).collect();
    let Some(table) = top.optional_table("coupling")? else {
        return match passive.len() {
            0 => Ok(()),
            _ => Err(top.lacks("table [coupling]: expected the two passive limbs, whose arms turn by the same angle")),
        };
    };
    table.only(&["limbs"])?;
    let bounds = Bounds { integer: true, ..Bounds::between(1.0, limbs.len() as f64) };
    let joined = table.numbers("limbs", Shape::Array(2), &bounds, None::<Unit>)?;
    if joined != passive {
        return Err(table.refuse("limbs", "expected the two limbs with `drive = false`, in order"));
    }
    Ok(())
}

/// Checks that the limbs hold the plate once, and that the drives move it, at the home pose; `table` is `[geometry]`.
///
/// More limbs than freedoms of plate and passive arms leave drives beyond the freedoms of the machine: their angles depend on
/// each other, and their torques contain a tension that the motion does not determine.
///
/// # Errors
/// The number of freedoms that is left, or of limbs beyond them, or the condition that the home pose violates.
pub(super) fn check(table: &Table, g: &Geometry) -> Checked<()> {
    let refuse = |why: String| Err(table.source.problem(table.span.clone(), why));
    let (limbs, unknowns) = (g.limbs.len(), g.unknowns());
    if unknowns > limbs {
        return refuse(format!(
            "[[limbs]]: {limbs} pairs of struts leave {} of {unknowns} freedoms of plate and passive arms to nothing; expected \
             {unknowns} limbs",
            unknowns - limbs
        ));
    }
    if unknowns < limbs {
        return refuse(format!(
            "[[limbs]]: {limbs} pairs of struts hold {unknowns} freedoms of plate and passive arms; {} of the drives would act \
             against others, with torques that no motion determines; expected {unknowns} limbs, or a [plate] whose parts turn \
             the tool",
            limbs - unknowns
        ));
    }
    let motion = match Motion::assembled(g, &JointState::default()) {
        Ok(motion) => motion,
        Err(e) => return refuse(format!("[[limbs]]: at the home pose q = 0: {e}; expected lengths that close there")),
    };
    match ChannelMap::new(g, &motion, true, &[Channel::StrutLower(0)]) {
        Ok(_) => Ok(()),
        Err(_) => refuse("[[limbs]]: the struts do not hold the plate at the home pose q = 0: it can tilt".into()),
    }
}

/// Writes limbs, plate and coupling where the file has none.
pub(super) fn write(root: &mut Edited, geometry: &Geometry) {
    if root.contains_key("limbs") {
        return;
    }
    let numbers = |v: &[f64], about: &str| {
        let mut item = match v {
            [one] => value(*one),
            all => value(all.iter().copied().collect::<Array>()),
        };
        if let Some(value) = item.as_value_mut() {
            value.decor_mut().set_suffix(format!(" # {about}"));
        }
        item
    };
    let vector = |v: &Vector3<f64>| numbers(v.as_slice(), "m");
    let mut plate = Edited::new();
    let mut put = |key: &str, item: Item| drop(plate.insert(key, item));
    match geometry.plate {
        Plate::Rigid => put("kind", value("rigid")),
        Plate::Par4 { main, connecting } => {
            put("kind", value("par4"));
            put("main", vector(&main));
            put("connecting", vector(&connecting));
        }
        Plate::H4 { hinges: [first, second] } => {
            put("kind", value("h4"));
            put("hinge1", vector(&first));
            put("hinge2", vector(&second));
        }
        Plate::I4 { azimuth, radius } => {
            put("kind", value("i4"));
            put("azimuth", numbers(&[azimuth], "rad"));
            put("radius", numbers(&[radius], "m"));
        }
    }
    root.insert("plate", Item::Table(plate));
    let mut all = ArrayOfTables::new();
    let mut passive = Array::new();
    for (i, limb) in (1..).zip(geometry.limbs.iter()) {
        let mut table = Edited::new();
        let coordinate = if limb.actuator == Actuator::Revolute { Unit::Rad } else { Unit::M };
        for field in LIMB {
            let unit = field.unit.filter(|_| field.key != "limits").or(Some(coordinate)).unwrap_or(Unit::One);
            table.insert(field.key, numbers(&(field.get)(limb), &format!("{unit}; {}", field.about)));
        }
        if let Actuator::Prismatic { inclination } = limb.actuator {
            table.insert("inclination", numbers(&[inclination], "rad; guide below the horizontal"));
        }
        if limb.part > 0 {
            table.insert("part", value(limb.part as i64 + 1));
        }
        if !limb.driven {
            table.insert("drive", value(false));
            passive.push(i);
        }
        all.push(table);
    }
    if !passive.is_empty() {
        let mut coupling = Edited::new();
        coupling.insert("limbs", value(passive));
        root.insert("coupling", Item::Table(coupling));
    }
    root.insert("limbs", Item::ArrayOfTables(all));
}
