//! Readers of one kind of file each, with the files that are mutated for them.

use std::path::{Path, PathBuf};

use deltatwin::effects::formula::Expression;
use deltatwin::machine::Mechanism;
use deltatwin::planner::Limits;
use deltatwin_io::outside::Access;
use deltatwin_io::{model, plan, recording, scenario, study};

/// A reader, which must return whatever it is given.
pub struct Target {
    pub name: &'static str,
    /// Name of the file it is given, in a folder with `models/` and `scenarios/` beside it.
    pub file: &'static str,
    /// Shipped files that are mutated; a name of a folder means all its files of the kind.
    pub seeds: &'static [&'static str],
    pub read: fn(&Path),
}

pub const TARGETS: [Target; 8] = [
    Target {
        name: "model",
        file: "models/mutated.toml",
        seeds: &["models"],
        read: |file| {
            let Ok(text) = std::fs::read_to_string(file) else { return };
            if let Ok(model) = model::parse(&text, file) {
                let _ = deltatwin::model::summary(&model);
                let _ = model::updated_text(&text, &model);
            }
        },
    },
    Target {
        name: "scenario",
        file: "scenarios/mutated.toml",
        seeds: &["scenarios"],
        read: |file| {
            if let Ok(scenario) = scenario::read_with(file, Access::with(deltatwin_cell::mesh::read))
                && let Ok(model) = model::read(&scenario.model)
            {
                let _ = scenario.motion(&model);
            }
        },
    },
    Target {
        name: "study",
        file: "scenarios/studies/mutated.toml",
        seeds: &["scenarios/studies"],
        read: |file| drop(study::read(file, Access::with(deltatwin_cell::mesh::read))),
    },
    Target {
        name: "path",
        file: "scenarios/mutated.toml",
        seeds: &[
            "scenarios/u-turn.toml",
            "scenarios/failures/bulky-path.toml",
            "scenarios/failures/believed-path.toml",
        ],
        read: |file| drop(plan::read_with(file, Limits::NONE, Access::with(deltatwin_cell::mesh::read))),
    },
    Target {
        name: "setup",
        file: "run.setup.toml",
        seeds: &["setup"],
        read: |file| drop(recording::setup::read(file)),
    },
    Target {
        name: "formula",
        file: "formula.txt",
        seeds: &["formula"],
        read: |file| {
            let Ok(text) = std::fs::read_to_string(file) else { return };
            if let Ok(expression) = Expression::parse(&text) {
                let _ = expression.value(|_| 1.5);
                let _ = expression.powers(Mechanism::default());
            }
        },
    },
    Target { name: "csv", file: "run.csv", seeds: &["recording.csv"], read: |file| drop(recording::read(file, None)) },
    Target {
        name: "mcap",
        file: "run.mcap",
        seeds: &["recording.mcap"],
        read: |file| drop(recording::read(file, None)),
    },
];

/// Seeds that are no shipped files.
pub fn made(name: &str) -> Option<Vec<Vec<u8>>> {
    match name {
        "setup" => Some(vec![
            b"configuration = \"assembled\"\n[payload]\nmass = 2.5\ncom = [0.03, -0.02, -0.08]\ninertia_zz = 0.012\n[noise]\n\
              torque = [0.5, 0.5, 0.5, 0.05]\n[columns]\nt = \"Time[ms]\"\ntau1 = \"Iq[A]*0.12\"\n"
                .to_vec(),
            b"joint = \"prismatic\"\neffort = \"A\"\n[payload]\nmass = 1\ncom = [0, 0, 0]\n\
              inertia = [0.02, 0.03, 0.012, 0.0, -0.004, 0.0]\n"
                .to_vec(),
        ]),
        "formula" => Some(
            ["tanh(qd1 / 0.1) * abs(q2)^1.5", "-(sin(3 * q1 + 0.2) + exp(-t / 10)) * sign(qd1)", "sqrt(abs(tau1)) / (1 + q1^2)"]
                .map(|text| text.as_bytes().to_vec())
                .to_vec(),
        ),
        _ => None,
    }
}

/// The contents of the seeds `name` in the project folder `root`.
pub fn seeds(root: &Path, name: &str) -> Vec<Vec<u8>> {
    if let Some(made) = made(name) {
        return made;
    }
    let path = root.join(name);
    let files: Vec<PathBuf> = match std::fs::read_dir(&path) {
        Ok(entries) => entries
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|p| p.extension().is_some_and(|e| e == "toml"))
            .collect(),
        Err(_) => vec![path],
    };
    let mut files = files;
    files.sort();
    files.iter().filter_map(|file| std::fs::read(file).ok()).collect()
}
