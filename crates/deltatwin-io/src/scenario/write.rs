//! Desired motions as the table `[motion]` of a scenario file.

use std::fmt::Write;

use deltatwin::scenario::{Course, FourierMotion};

/// The table `[motion]`, which reads back as the same motion; `None` for a look-up table, which is a separate file.
pub fn motion_text(course: &Course) -> Option<String> {
    let mut out = String::from("[motion]\n");
    match course {
        Course::RandomFourier { seed, frequency, harmonics, share } => {
            let _ = write!(
                out,
                "kind = \"random_fourier\"\nseed = {seed}\nfrequency = {frequency:?} # Hz\nharmonics = {harmonics}\n\
                 share = {share:?} # of the limits on speed, acceleration and torque\n"
            );
        }
        Course::Fourier(series) => out += &fourier(series),
        Course::Path(path) => {
            out += "kind = \"path\"\n";
            out += &rows("waypoints", &path.waypoints, "x, y, z in m and ψ in rad");
            let _ = write!(
                out,
                "closed = {}\nrepeat = {}\nblend = {:?} # m\nspeed = {:?} # m/s\nacceleration = {:?} # m/s²\n\
                 jerk = {:?} # m/s³\nturn_radius = {:?} # m\nstops = {:?}\ndwell = {:?} # s\n",
                path.closed,
                path.laps,
                path.blend,
                path.speed,
                path.acceleration,
                path.jerk,
                path.turn_radius,
                path.stops.iter().map(|i| i + 1).collect::<Vec<_>>(),
                path.dwell
            );
        }
        Course::Table(_) => return None,
        Course::ConstantSpeed(runs) => {
            let _ = write!(
                out,
                "kind = \"constant_speed\"\naxis = {}\npose = {:?} # m, rad\nbetween = {:?} # rad\n\
                 speeds = {:?} # rad/s, each to and fro\nacceleration = {:?} # rad/s²\nrepeat = {}\n",
                runs.axis + 1,
                runs.pose,
                runs.between,
                runs.speeds,
                runs.acceleration,
                runs.repeat
            );
        }
        Course::StaticPoses(poses) => {
            out += "kind = \"static_poses\"\n";
            out += &rows("poses", &poses.poses, "x, y, z in m and ψ in rad");
            let _ = write!(
                out,
                "hold = {:?} # s at each pose\nmove = {:?} # s from pose to pose\n",
                poses.hold, poses.travel
            );
        }
    }
    Some(out)
}

fn fourier(series: &FourierMotion) -> String {
    format!(
        "kind = \"fourier\"\nfrequency = {:?} # Hz\ncentre = {:?} # x, y, z in m and ψ in rad\n{}{}",
        series.frequency,
        series.centre,
        rows("sine", &series.sine, "one row per harmonic"),
        rows("cosine", &series.cosine, "one row per harmonic")
    )
}

fn rows(key: &str, rows: &[[f64; 4]], what: &str) -> String {
    let lines: String = rows.iter().map(|row| format!("    {row:?},\n")).collect();
    format!("{key} = [ # {what}\n{lines}]\n")
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::{parse, read};
    use super::*;

    #[test]
    fn written_motions_are_read_back() {
        let mut kinds = 0;
        for entry in std::fs::read_dir("../../scenarios").unwrap() {
            let path = entry.unwrap().path();
            let Ok(scenario) = read(&path) else { continue };
            let Some(text) = motion_text(&scenario.motion) else { continue };
            let head = "model = \"../models/irb360-6-1600.toml\"\nduration = 1.0\n";
            let again = parse(&format!("{head}{text}"), Path::new("../../scenarios/test.toml")).unwrap();
            assert_eq!(again.motion, scenario.motion, "{}", path.display());
            kinds += 1;
        }
        assert!(kinds > 8, "{kinds}");
    }
}
