//! A diagnosis as a sentence of engineering: what acts on the machine and how strongly, the catalogue's name behind it.

use deltatwin::diagnosis::{Diagnosis, Named, Verdict};
use deltatwin::effects::{Count, Role};
use deltatwin::identification::Estimate;
use deltatwin::text::{significant, with_error};

/// Largest number of the members of a set that are described; the table of the candidates has all.
const NAMED: usize = 4;

/// The verdict in one or two sentences.
pub fn verdict(d: &Diagnosis) -> String {
    let all = |effects: &[&Named]| effects.iter().map(|e| described(d, e)).collect::<Vec<_>>().join("; and ");
    let effects: Vec<&Named> = d.effects.iter().collect();
    let first = match (d.verdict, effects.len()) {
        (Verdict::None, _) if d.left.is_extrapolated => {
            "The recordings fitted to do not determine the model for the motion held out: fit one as wide and as fast"
                .to_string()
        }
        (Verdict::None, _) => "Nothing is missing that these data show".to_string(),
        (Verdict::Effect, _) => format!("One effect is missing: {}", all(&effects)),
        (Verdict::Several, n) => format!("{n} effects are missing: {}", all(&effects)),
        (Verdict::Ambiguous, _) => ambiguous(d, &all),
        (Verdict::Unknown, 0) => "Something is missing that no known effect explains".to_string(),
        (Verdict::Unknown, _) => {
            format!("Something is missing that no known effect explains, next to {}", all(&effects))
        }
        (Verdict::Undecided, 0) => format!("Undecided: {} before it was clear what is missing", ended(d)),
        (Verdict::Undecided, _) => format!("Undecided: {}; found until then: {}", ended(d), all(&effects)),
    };
    let left = much(d);
    if let Some(few) = d.too_few.filter(|_| effects.is_empty()) {
        let first = if left.is_empty() { "The model leaves no more than the noise" } else { left.as_str() };
        return format!("{first}; {few}.");
    }
    let is_more = d.left.beside && !d.left.is_noise && d.verdict != Verdict::Unknown;
    let sentence = match (is_more, left.is_empty()) {
        (true, _) => format!("{first} ... and something else: {left}."),
        (false, true) => format!("{first}."),
        (false, false) => format!("{first}. {left}."),
    };
    let few = d.too_few.map(|few| format!(" Only the error with and without it shows that: {few}."));
    let sentence = format!("{sentence}{}", few.unwrap_or_default());
    match d.not_tried.as_slice() {
        [] => sentence,
        [step] => format!("{sentence} The search was cut short: {step} was not tried."),
        [step, others @ ..] => {
            format!("{sentence} The search was cut short: {step} and {} more were not tried.", others.len())
        }
    }
}

/// What ended the search.
pub(crate) fn ended(d: &Diagnosis) -> &'static str {
    if d.is_work_spent { "the work of a diagnosis was spent" } else { "the time was up" }
}

/// What is clear, and what the data do not distinguish.
fn ambiguous(d: &Diagnosis, all: &dyn Fn(&[&Named]) -> String) -> String {
    let is_open = |e: &&Named| d.indistinguishable.iter().any(|set| set.contains(&e.name));
    let clear: Vec<&Named> = d.effects.iter().filter(|e| !is_open(e)).collect();
    let set = |names: &Vec<String>| {
        let likeliest = names.iter().take(NAMED).map(|name| called(d, name)).collect::<Vec<_>>().join(", or ");
        match names.len().saturating_sub(NAMED) {
            0 => likeliest,
            more => format!("{likeliest}, or one of {more} others"),
        }
    };
    let sets: Vec<String> = d.indistinguishable.iter().map(set).collect();
    let first = match clear.is_empty() {
        true => "Something is missing, and these".to_string(),
        false => format!("This is missing: {}; and something of which these", all(&clear)),
    };
    format!("{first} data do not show whether it is {}", sets.join("; nor whether "))
}

/// What an effect is, with its name in the catalogue.
fn called(d: &Diagnosis, name: &str) -> String {
    let own = d.model.effects.iter().map(|a| &a.effect).find(|e| e.name() == name).cloned();
    let effect = own.or_else(|| deltatwin::effects::find(name));
    effect.map_or_else(|| name.to_string(), |e| format!("{} ({name})", e.spec().about.summary))
}

/// What a found effect is, its size, how much it explains, and how sure that is.
fn described(d: &Diagnosis, e: &Named) -> String {
    let size = size(d, e).map(|size| format!(", {size}")).unwrap_or_default();
    let explains = match d.effects.len() {
        1 if e.explained > 0.995 => "it explains all of the error above the noise, ".to_string(),
        1 => format!("it explains {:.0} % of the error above the noise, ", 100.0 * e.explained),
        _ => String::new(),
    };
    format!("{}{size}; {explains}probability {:.2}", called(d, &e.name), e.confidence.probability())
}

/// The size of an effect: of the parameters in the unit of the one with the smallest relative error the largest, with its
/// axis or, next to others, its name.
fn size(d: &Diagnosis, e: &Named) -> Option<String> {
    let active = d.model.effects.iter().find(|a| a.effect.name() == e.name)?;
    let parameter = |p: &Estimate| active.effect.spec().parameters.get(p.param.block);
    let is_size = |p: &&Estimate| p.identified() && parameter(p).is_some_and(|own| own.role == Role::Linear);
    let sizes: Vec<&Estimate> = e.parameters.iter().filter(is_size).collect();
    let relative = |p: &Estimate| p.value.abs() / p.std;
    let surest = sizes.iter().max_by(|a, b| relative(a).total_cmp(&relative(b)))?;
    let alike = sizes.iter().filter(|p| p.unit == surest.unit && relative(p) >= relative(surest).min(3.0));
    let p = alike.max_by(|a, b| a.value.abs().total_cmp(&b.value.abs()))?;
    let size = p.unit.quantity(with_error(p.value, p.std));
    let is_per_axis = matches!(
        parameter(p)?.count,
        Count::PerArm | Count::PerLimb | Count::PerDrive | Count::PerAxis | Count::AllDrives
    );
    Some(match (is_per_axis, d.model.mechanism.axes(), sizes.len()) {
        (true, 2.., _) => format!("{size} on axis {}", p.param.item + 1),
        (true, ..) | (_, _, 1) => size,
        _ => format!("{} {size}", p.name),
    })
}

/// The residual above the noise as text; empty if there is none.
fn much(d: &Diagnosis) -> String {
    let channels = d.left.channels(&d.channels);
    let Some((worst, ratio)) = channels.first() else { return String::new() };
    let others = match channels.len() {
        1 => String::new(),
        n => format!(" and more than 1.15 times on {} other{}", n - 1, if n == 2 { "" } else { "s" }),
    };
    let coarse = d.smoothing.map_or_else(String::new, |time| {
        format!(", in part from coarse angles (smoothed over {} ms)", significant(1e3 * time, 2))
    });
    let (noise, memory) = match d.left.is_noise {
        true => {
            ("white noise", ": noise with a memory that follows neither place nor motion; what is smaller hides in it")
        }
        false => ("noise", ""),
    };
    let (ratio, worst) = (significant(*ratio, 2), worst.title(d.model.mechanism));
    format!("{ratio} times the {noise} is left on {worst}{others}{coarse}{memory}")
}
