//! Page of an exam.

use deltatwin_report::{Callout, Report};

use super::Grade;
use super::figures;
use super::score::{Judged, Rate, Score};

/// One self-contained page: how often the diagnosis is right, where it is not, and how far its numbers can be trusted.
pub fn page(score: &Score, judged: &[Judged], machine: &str) -> Report {
    let right = Rate::of(judged, |j| j.grade == Grade::Right);
    let subtitle = format!("{} robots with a known truth, diagnosed like measurements of {machine}", judged.len());
    let mut page = Report::new("Exam of the diagnosis", subtitle);
    tiles(&mut page, score, right);
    if score.failed > 0 {
        page.callout(Callout::Bad, &format!("{} campaign(s) have no answer.", score.failed));
    }
    page.anchored("rates", "How often it is right");
    let rows: Vec<[String; 4]> = score
        .rates()
        .into_iter()
        .map(|(what, rate)| {
            let [low, high] = rate.interval().map(|x| 1e2 * x);
            let share = format!("{:.1} %", 1e2 * rate.share().unwrap_or_default());
            let what = what.replace("  ", "\u{2003}");
            [what, format!("{} of {}", rate.count, rate.of), share, format!("{low:.1} to {high:.1} %")]
        })
        .collect();
    page.table(&["rate", "campaigns", "share", "95 % interval (Wilson)"], &rows);
    page.anchored("figures", "What it confuses, and what it claims");
    for (name, figure) in figures::all(score, judged) {
        page.figure(&figure, caption(name));
    }
    let wrong: Vec<&Judged> = judged.iter().filter(|j| j.grade != Grade::Right).collect();
    page.anchored("wrong", "Campaigns that are not answered rightly");
    if wrong.is_empty() {
        page.paragraph("None.");
    } else {
        let row = |j: &&Judged| {
            let [verdict, named, probability, ratio] = j.answered();
            [j.name.clone(), j.hidden(), verdict, named, j.grade.to_string(), probability, ratio]
        };
        let rows: Vec<[String; 7]> = wrong.iter().map(row).collect();
        page.cards(&["campaign", "hidden", "verdict", "named", "grade", "probability", "left / noise"], &rows);
    }
    page
}

fn tiles(page: &mut Report, score: &Score, right: Rate) {
    let tile = |rate: Rate, what: &str| {
        let [low, high] = rate.interval().map(|x| 1e2 * x);
        let value = format!("{:.1} %", 1e2 * rate.share().unwrap_or_default());
        [value, what.to_string(), format!("{} of {}; 95 % interval {low:.1} to {high:.1} %", rate.count, rate.of)]
    };
    let all = [
        (right, "right answers"),
        (score.false_alarms, "false alarms where nothing is hidden"),
        (score.confidently_wrong, "confidently wrong"),
    ];
    let mut tiles: Vec<[String; 3]> =
        all.into_iter().filter(|(rate, _)| rate.of > 0).map(|(rate, what)| tile(rate, what)).collect();
    if let Some([median, most]) = score.time() {
        tiles.push([format!("{median:.1} s"), "per diagnosis".into(), format!("median; at most {most:.1} s")]);
    }
    let tiles: Vec<[&str; 3]> = tiles.iter().map(|tile| tile.each_ref().map(String::as_str)).collect();
    page.tiles(&tiles);
}

/// What a figure of an exam shows.
fn caption(name: &str) -> &'static str {
    match name {
        "confusion" => "Campaigns by what was hidden and what was named first; green is right, red is wrong.",
        "effects" => {
            "Right answers by hidden effect and its size; green where most are right, red where most are wrong."
        }
        "power" => {
            "How large an effect must be to be found: what a refit leaves of it, in units of the noise, with 95 % intervals."
        }
        "reliability" => "Whether a claimed probability comes true; on the dashed line it does.",
        "held-out" => "What is left on a motion that the fit has not seen, once the right effect is added.",
        _ => "Errors of the estimated parameters, beside what their standard errors promise.",
    }
}
