//! `deltatwin effects`.

use miette::miette;
use serde_json::{Value, json};
use std::sync::Arc;

use crate::terminal::{DONE, Table, say};
use deltatwin::effects::{Count, Effect, Parameter, REGISTRY, Role, find};
use deltatwin::text::nearest;

/// List the physical effects, or describe one.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin effects ball_socket_coulomb")]
pub struct Args {
    /// Effect to describe.
    pub name: Option<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    match &args.name {
        Some(name) => {
            let effect = known(name)?;
            if args.json { say(json(&*effect)) } else { describe(&*effect) }?;
        }
        None if args.json => {
            let entry = |e: &Arc<dyn Effect>| json!({"name": e.name(), "summary": e.spec().about.summary});
            say(json!({"effects": REGISTRY.iter().map(entry).collect::<Vec<_>>()}))?;
        }
        None => {
            let mut table = Table::new(&["Effect", "what it is"], &[1]);
            for effect in REGISTRY.iter() {
                table.row([effect.name().into(), effect.spec().about.summary.into()]);
            }
            say(table)?;
        }
    }
    Ok(DONE)
}

/// The effect called `name`, or an error that suggests the nearest name.
pub(crate) fn known(name: &str) -> miette::Result<Arc<dyn Effect>> {
    find(name).ok_or_else(|| {
        let hint = nearest(name, REGISTRY.iter().map(|e| e.name()));
        let hint = hint.map_or(String::new(), |n| format!("did you mean `{n}`? "));
        miette!("unknown effect `{name}`; {hint}`deltatwin effects` lists them")
    })
}

fn role(p: &Parameter) -> &'static str {
    match p.role {
        Role::Linear => "linear",
        Role::Shape => "shape",
        Role::Fixed => "fixed",
    }
}

fn count(p: &Parameter) -> String {
    match p.count {
        Count::One => "one".into(),
        Count::PerArm => "one per arm".into(),
        Count::PerLimb => "one per limb".into(),
        Count::PerStrut => "one per strut".into(),
        Count::PerDrive => "one per drive".into(),
        Count::PerAxis | Count::AllDrives => "one per axis".into(),
        Count::Named(names) => names.join(", "),
        Count::List => "any number".into(),
        Count::PerArmOf(_) => "one per arm and value of the list".into(),
    }
}

fn json(effect: &dyn Effect) -> Value {
    let about = effect.spec().about;
    let parameter = |p: &Parameter| {
        json!({
            "name": p.name,
            "unit": p.unit.to_string(),
            "range": [p.range.0, p.range.1],
            "default": p.default,
            "role": role(p),
            "count": count(p),
        })
    };
    json!({
        "name": effect.name(),
        "summary": about.summary,
        "law": about.law,
        "shows": about.shows,
        "source": about.source,
        "acts_on": effect.acts_on().describe(),
        "parameters": effect.parameters().iter().map(parameter).collect::<Vec<_>>(),
    })
}

fn describe(effect: &dyn Effect) -> miette::Result<()> {
    let about = effect.spec().about;
    say(format!("{}: {}\n", effect.name(), about.summary))?;
    let on = effect.acts_on().describe();
    say(format!("  law     {}\n  acts on {on}\n  shows   {}\n  source  {}\n", about.law, about.shows, about.source))?;
    let mut table = Table::new(&["Parameter", "usual", "range", "unit", "role", "values"], &[3, 4, 5]);
    for p in effect.parameters() {
        let range = format!("{} to {}", p.range.0, p.range.1);
        table.row([p.name.to_string(), p.default.to_string(), range, p.unit.to_string(), role(p).into(), count(p)]);
    }
    say(table)
}
