//! Bar chart of errors relative to the noise floor.

use deltatwin::machine::Mechanism;
use deltatwin::recording::Channel;
use deltatwin::text::significant;

/// Number of columns of a bar per noise floor, and number of noise floors in a bar.
const FLOOR: usize = 8;
const FLOORS: usize = 4;

/// RMS errors of every channel before and after and the noise floor, as numbers and as bars in units of the floor.
pub fn error_bars(
    machine: Mechanism,
    channels: &[Channel],
    held_out: bool,
    before: &[f64],
    after: &[f64],
    floor: &[f64],
) -> String {
    let title = if held_out { "RMS error, held out" } else { "RMS error" };
    let scale: String = (0..FLOORS).map(|k| format!("{:<FLOOR$}", k)).collect();
    let mut text =
        format!("  {title:<20} {:>8}   {:>8} {:>8}      {scale}{FLOORS} × noise\n", "before", "after", "noise");
    for (c, &channel) in channels.iter().enumerate() {
        let [b, a, f] = [before[c], after[c], floor[c]].map(|x| significant(x, 4));
        let bar = bar(before[c] / floor[c], after[c] / floor[c]);
        text +=
            &format!("  {:<20} {b:>8} → {a:>8} {f:>8} {:<4} {bar}\n", channel.title(machine), channel.unit(machine));
    }
    text + "  █ left   ░ taken away   │ noise floor   » beyond the scale"
}

/// Bar of the remaining and the removed error, in units of the noise floor.
fn bar(before: f64, after: f64) -> String {
    let columns = |ratio: f64| (ratio * FLOOR as f64).round().clamp(0.0, 1e6) as usize;
    let (left, whole) = (columns(after), columns(before).max(columns(after)));
    let end = FLOOR * FLOORS;
    let cell = |k: usize| match k {
        FLOOR => '│',
        k if k == end && whole > end => '»',
        k if k < left => '█',
        k if k < whole => '░',
        _ => ' ',
    };
    (0..=end).map(cell).collect::<String>().trim_end().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_show_what_is_left_and_what_went() {
        assert_eq!(bar(2.0, 1.0), "████████│░░░░░░░");
        assert_eq!(bar(1.0, 1.0), "████████│");
        assert_eq!(bar(18.0, 1.5).chars().last(), Some('»'));
        assert_eq!(bar(18.0, 1.5).chars().filter(|c| *c == '█').count(), 11);
        assert_eq!(bar(f64::NAN, 0.5), "████    │");
    }

    #[test]
    fn rows_fit_the_screen() {
        let text = error_bars(
            Mechanism::default(),
            &[Channel::StrutUpper(0), Channel::Torque(3)],
            true,
            &[1e5, 9.0],
            &[1e5, 1.0],
            &[1e-3, 1.0],
        );
        assert!(text.lines().all(|l| l.chars().count() <= super::super::WIDTH), "{text}");
        assert_eq!(text.lines().count(), 4);
    }
}
