//! RMS errors as bars against the noise floor, one row per channel.

use std::fmt::Write as _;

use deltatwin::machine::Mechanism;
use deltatwin::recording::Channel;

use super::number;
use crate::html::escape;
use crate::{Report, Role};

/// RMS errors of one channel set at several stages of a model.
pub struct Errors<'a> {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Channels, in the order of the arrays.
    pub channels: &'a [Channel],
    /// Stage of the model, its name and RMS errors, N·m or N, the first one first.
    pub stages: Vec<(Role, &'a str, &'a [f64])>,
    /// Standard deviation of the noise, N·m or N.
    pub noise_floor: &'a [f64],
    /// Whether the errors are those of held-out recordings.
    pub held_out: bool,
}

impl Errors<'_> {
    /// The error of the worst channel in noise floors at each stage; `None` without noise.
    pub fn worst(&self) -> Option<Vec<f64>> {
        let of = |rms: &[f64]| {
            let ratios = rms.iter().zip(self.noise_floor).map(|(r, n)| r / n).filter(|r| r.is_finite());
            ratios.reduce(f64::max)
        };
        self.stages.iter().map(|(_, _, rms)| of(rms)).collect()
    }
}

/// Adds the errors: per channel a bar for every stage, the noise floor as a line through them, and the numbers.
pub fn add(report: &mut Report, errors: &Errors) {
    let mut html = String::from("<div class=\"errors\" role=\"table\" aria-label=\"RMS errors and noise floor\">\n");
    let title = if errors.held_out { "RMS error, held-out recordings" } else { "RMS error" };
    let _ = writeln!(html, "<p class=\"small\">{title}; dashed: noise floor of the channel.</p>");
    html.push_str("<p class=\"keys\">");
    for (role, name, _) in &errors.stages {
        let _ = write!(html, "<span><i class=\"{}\"></i>{}</span>", role.class(), escape(name));
    }
    html.push_str("<span><i class=\"floor\"></i>noise</span></p>\n");
    for (c, channel) in errors.channels.iter().enumerate() {
        let floor = errors.noise_floor.get(c).copied().unwrap_or(f64::NAN);
        let value = |rms: &[f64]| rms.get(c).copied().unwrap_or(f64::NAN);
        let all = errors.stages.iter().map(|(_, _, rms)| value(rms)).chain([floor]);
        let largest = all.filter(|x| x.is_finite()).fold(f64::MIN_POSITIVE, f64::max);
        let percent = |x: f64| if x.is_finite() { 100.0 * x / largest } else { 0.0 };
        let unit = escape(&channel.unit(errors.mechanism).to_string());
        let _ = write!(
            html,
            "<div class=\"error\" role=\"row\"><b role=\"rowheader\">{}</b><div class=\"bars\">",
            escape(&channel.title(errors.mechanism))
        );
        for (role, name, rms) in &errors.stages {
            let (x, class) = (value(rms), role.class());
            let times = if floor > 0.0 {
                format!(" ({} × noise)", deltatwin::text::significant(x / floor, 3))
            } else {
                String::new()
            };
            let (name, key) = (escape(name), escape(&format!("{channel}/{name}")));
            let _ = write!(
                html,
                "<div class=\"bar\" role=\"cell\" title=\"{name}: {value} {unit}{times}\"><i class=\"{class}\" data-bar=\"{key}\" style=\"width:{:.2}%\"></i></div>",
                percent(x),
                value = number(x),
            );
        }
        let numbers: Vec<String> = errors.stages.iter().map(|(_, _, rms)| number(value(rms))).collect();
        let _ = writeln!(
            html,
            "<i class=\"floor\" style=\"left:{:.2}%\"></i></div><span class=\"numbers\" role=\"cell\">{} {unit}<small>noise {}</small></span></div>",
            percent(floor),
            numbers.join(" → "),
            number(floor)
        );
    }
    html.push_str("</div>");
    report.push(html);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_have_the_length_of_the_error_and_the_floor_its_place() {
        let mut report = Report::new("t", "");
        let errors = Errors {
            mechanism: Mechanism::default(),
            channels: &[Channel::Torque(0)],
            stages: vec![(Role::Nominal, "before", &[2.0]), (Role::Added, "after", &[0.5])],
            noise_floor: &[0.4],
            held_out: true,
        };
        add(&mut report, &errors);
        let page = report.render();
        for text in ["width:100.00%", "width:25.00%", "left:20.00%", "2.000 → 0.5000 N·m", "(5.00 × noise)", "held-out"]
        {
            assert!(page.contains(text), "{text}\n{page}");
        }
        assert_eq!(errors.worst(), Some(vec![5.0, 1.25]));
    }
}
