//! Candidates of a diagnosis as cards.

use std::fmt::Write as _;

use deltatwin::diagnosis::candidates::Standing;
use deltatwin::diagnosis::{CandidateReport, Diagnosis, Named};
use deltatwin::effects;

use crate::Report;
use crate::html::escape;

/// Number of cards shown at once in addition to those of the effects found and their rivals.
const OTHERS: usize = 3;

/// Adds a card for every candidate that the data can test, those found first, most of the others folded away; and those
/// that the data cannot test as a list with the reason.
pub fn add(report: &mut Report, d: &Diagnosis) {
    let tested = |c: &&CandidateReport| c.standing != Standing::Untestable;
    let named = |c: &&CandidateReport| matches!(c.standing, Standing::Found | Standing::Rival | Standing::Doubted);
    let (first, others): (Vec<_>, Vec<_>) = d.candidates.iter().filter(tested).partition(named);
    let (next, rest) = others.split_at(OTHERS.min(others.len()));
    let cards = |candidates: &[&CandidateReport]| {
        let mut html = String::from("<div class=\"candidates\">\n");
        candidates.iter().for_each(|candidate| card(&mut html, candidate, d));
        html + "</div>"
    };
    report.push(cards(&[&first[..], next].concat()));
    if !rest.is_empty() {
        let summary = format!("{} more candidates that were tested", rest.len());
        report.push(format!("<details><summary>{summary}</summary>{}</details>", cards(rest)));
    }
    let not: Vec<&CandidateReport> = d.candidates.iter().filter(|c| !tested(c)).collect();
    if not.is_empty() {
        return;
    }
    let mut html = format!("<details><summary>Not testable with these recordings: {} effects</summary><ul>", not.len());
    for candidate in not {
        let reason = candidate.untestable.map_or(String::new(), |why| why.to_string());
        let _ = write!(html, "<li><code>{}</code>: {}</li>", escape(&candidate.name), escape(&reason));
    }
    html.push_str("</ul></details>");
    report.push(html);
}

fn card(html: &mut String, candidate: &CandidateReport, d: &Diagnosis) {
    let named = d.effects.iter().find(|e| e.name == candidate.name);
    let class = match candidate.standing {
        Standing::Found => " found",
        Standing::Rival | Standing::Doubted => " open",
        _ => "",
    };
    let name = escape(&candidate.name);
    let about = effects::find(&candidate.name).map(|effect| effect.spec().about);
    let title = about.map_or(name.clone(), |about| escape(about.summary));
    let _ = write!(
        html,
        "<article class=\"candidate{class}\" data-effect=\"{name}\"><header><h3>{title}</h3><span class=\"standing\">{}</span></header>",
        escape(&candidate.standing.to_string())
    );
    if let Some(about) = about {
        let _ = write!(
            html,
            "<p class=\"small\"><code>{name}</code></p><p class=\"law\"><code>{}</code></p><p class=\"small\"><b>Shows</b> {}</p>",
            escape(about.law),
            escape(about.shows)
        );
    }
    share(html, "alone", candidate.explained);
    if let Some(named) = named {
        let what = if d.effects.len() > 1 { "lost without it" } else { "with refit" };
        share(html, what, named.explained);
    }
    let _ = write!(html, "<p class=\"small\"><b>Probability</b> {:.2}", candidate.probability);
    if candidate.p_adjusted.is_finite() {
        let _ = write!(html, " · <b>p</b> {}", deltatwin::text::significant(candidate.p_adjusted, 2));
    }
    html.push_str("</p>");
    if let Some(named) = named {
        values(html, named);
    }
    if !candidate.absorbed_by.is_empty() {
        let short = |n: &String| format!("<code>{}</code>", escape(n.trim_start_matches("rigid_bodies.")));
        let names: Vec<String> = candidate.absorbed_by.iter().map(short).collect();
        let _ = write!(html, "<p class=\"small\"><b>Imitated by</b> {}</p>", names.join(", "));
    }
    let mut rivals: Vec<&String> =
        d.indistinguishable.iter().filter(|set| set.contains(&candidate.name)).flatten().collect();
    rivals.retain(|name| **name != candidate.name);
    rivals.sort_unstable();
    rivals.dedup();
    if !rivals.is_empty() {
        let names: Vec<String> = rivals.iter().map(|n| format!("<code>{}</code>", escape(n))).collect();
        let _ = write!(html, "<p class=\"small\"><b>Not distinguishable from</b> {}</p>", names.join(", "));
    }
    html.push_str("</article>\n");
}

/// A share of the error above the noise, as a bar with its number.
fn share(html: &mut String, what: &str, share: f64) {
    let percent = 100.0 * share.clamp(0.0, 1.0);
    let _ = write!(
        html,
        "<div class=\"share\"><span>{what}</span><div class=\"bar\"><i style=\"width:{percent:.1}%\"></i></div><b>{percent:.1} %</b></div>"
    );
}

/// The parameters of a named effect with their standard errors.
fn values(html: &mut String, named: &Named) {
    html.push_str("<ul class=\"values\">");
    for p in &named.parameters {
        let text = match p.identified() {
            true => p.unit.quantity(super::parameters::text(p)),
            false => "not determined alone".into(),
        };
        let _ = write!(html, "<li><code>{}</code> {}</li>", escape(&p.name), escape(&text));
    }
    html.push_str("</ul>");
}
