use super::*;

fn layout(names: &[&str], maps: &[&str]) -> Result<Layout, String> {
    let names: Vec<String> = names.iter().map(|n| n.to_string()).collect();
    let maps: Vec<Mapping> = maps.iter().map(|m| m.parse().unwrap()).collect();
    let how = Reading { maps: &maps, ..Reading::default() };
    let file = Path::new("run.csv");
    let layout = Layout::new(file, &names, &how).map_err(|e| e.to_string())?;
    layout.check(file, layout.machine()).map_err(|e| e.to_string())?;
    Ok(layout)
}

fn source(layout: &Layout, channel: &str) -> (usize, f64, f64) {
    let (_, s) = layout.channels.iter().find(|(name, _)| name == channel).unwrap_or_else(|| panic!("{channel}"));
    (s.column, s.factor, s.offset)
}

fn refused(names: &[&str], maps: &[&str], parts: &[&str]) {
    let message = layout(names, maps).err().unwrap_or_else(|| panic!("{names:?} {maps:?}"));
    for part in parts {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn names_and_units_are_told_apart() {
    let l = layout(&["time_ms", "position_1 [deg]", "effort_1 [Nmm]", "note"], &[]).unwrap();
    assert_eq!(source(&l, "t"), (0, 1e-3, 0.0));
    assert!((source(&l, "q1").1 - std::f64::consts::PI / 180.0).abs() < 1e-18);
    assert_eq!(source(&l, "tau1"), (2, 1e-3, 0.0));
    assert_eq!(l.unused, [3]);
    assert!(l.notes[0].contains("`position_1 [deg]`"), "{:?}", l.notes);
    // Numbered from zero.
    let l = layout(&["t", "position[0]", "position[1]", "position[2]", "effort[0]"], &[]).unwrap();
    assert_eq!((source(&l, "q1").0, source(&l, "q3").0, source(&l, "tau1").0), (1, 3, 4));
    // The format's own names produce no notes.
    assert!(layout(&["t", "q1", "tau1 [Nm]"], &[]).unwrap().notes.is_empty());
    assert_eq!(source(&layout(&["t", "position", "torque"], &[]).unwrap(), "tau1").0, 2);
}

#[test]
fn two_columns_for_one_channel_are_refused_by_both_names() {
    refused(&["t", "time", "q1"], &[], &["`t` and `time`", "--map"]);
    refused(&["t", "q1", "position_1"], &[], &["`q1` and `position_1`"]);
    refused(&["t", "q1 [rad]", "q1 [deg]"], &[], &["`q1 [rad]` and `q1 [deg]`"]);
    let l = layout(&["t", "q1", "position_1 [deg]"], &["q1='position_1 [deg]'"]).unwrap();
    assert_eq!(source(&l, "q1").0, 2);
}

#[test]
fn units_that_do_not_fit_are_refused_by_the_columns_name() {
    refused(&["t", "q1 [furlong]"], &[], &["column `q1 [furlong]`", "no unit that is known", "deg"]);
    refused(&["t", "q1 [N]"], &[], &["`q1 [N]`: N is no unit of q1"]);
    refused(&["t", "tau1 [%]"], &[], &["`tau1 [%]` is in %", "--map"]);
    refused(&["t", "tau1 [A]", "tau2"], &[], &["`tau1 [A]` is in A", "--map"]);
    refused(&["t", "I1", "q2"], &["tau1=I1[A]"], &["factor to SI"]);
    let l = layout(&["t", "tau1 [A]"], &["tau1='tau1'[A]*0.12"]).unwrap();
    assert_eq!(source(&l, "tau1"), (1, 0.12, 0.0));
    let l = layout(&["t", "tau1 [A]"], &["tau1=tau1*0.12"]).unwrap();
    assert_eq!(source(&l, "tau1"), (1, 0.12, 0.0));
}

#[test]
fn mappings_work_on_what_was_read_before() {
    let names = ["Time", "ActPos [deg]", "q2", "Iq"];
    let l = layout(&names, &["q1='ActPos [deg]'-90, tau1=Iq[A]*0.12", "q1=-q1, tau1=-33*tau1", "q1=q2, q2=q1"]);
    let l = l.unwrap();
    let degree = std::f64::consts::PI / 180.0;
    let (column, factor, offset) = source(&l, "q2");
    assert_eq!((column, factor), (1, -degree));
    assert!((offset - 90.0 * degree).abs() < 1e-15);
    assert_eq!(source(&l, "q1"), (2, 1.0, 0.0));
    let (column, factor, _) = source(&l, "tau1");
    assert!(column == 3 && (factor + 33.0 * 0.12).abs() < 1e-12, "{factor}");
    refused(&names, &["q1=Position"], &["`Position`, which is not there", "ActPos [deg]"]);
}

#[test]
fn factors_have_six_digits_or_are_fractions_of_pi() {
    for (factor, text) in [
        ((-1.0f64).to_radians(), "−π/180"),
        (std::f64::consts::TAU / 60.0, "π/30"),
        (0.449, "0.449"),
        (-0.123_456_789, "-0.123457"),
        (2.732_421_6e-8, "2.73242e-8"),
    ] {
        assert_eq!(super::in_digits(factor), text);
    }
}
