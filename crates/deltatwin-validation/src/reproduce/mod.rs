//! Reproduction of the paper's experiments with the twin, compared with the paper's numbers.
//!
//! [`runs::Campaign`] records every scenario on its variant of one virtual robot. The sections evaluate these
//! recordings as in the paper and in its order, and [`mod@page`] compares the results with the printed ones.

pub mod arms;
pub mod assembled;
mod figures;
pub mod friction_curve;
pub mod inputs;
pub mod least_squares;
pub mod page;
pub mod paper;
pub mod prior;
pub mod robot;
pub mod runs;
mod strut_force;
mod u_turn;
mod verification;

use miette::miette;

use deltatwin_report::Report;
use page::{Comparison, Section};
use runs::Campaign;

/// Limitations of the comparison, independent of the results.
const LIMITS: &str = "\
The paper's measurements are confidential. The robot here is the twin, and it was given the paper's printed results: \
Table 1 for arms and drives, Table 2 for drive 4, Table 3 for struts, platform and telescope, Table 4 for the telescope's \
sliding joint. Where an identification returns one of these numbers, it shows that the method works on data as they come \
from encoders and drives, not that the paper's numbers are right.

- **Motions.** The paper prints no trajectory. Excitation and verification are motions designed here under the paper's \
  limits; ranges of torques and forces depend on them.
- **Noise.** The paper prints neither Σ nor the resolution of its torques. The twin's noise is white with assumed standard \
  deviations, so standard errors and RMS errors are those of the twin.
- **Sockets.** The friction of the ball sockets is an estimate that was chosen so that the drives' viscous friction grows \
  about as the paper found. Kind and direction of the growth are a result, its size is not.
- **Arms.** The paper's Tables 1 and 3 differ in the arms (m c_x 0.152 and 0.176 kg·m). One robot cannot have both: \
  the twin has Table 1.
- **Regularisation.** The paper gives neither the weights γ of eq. 10 nor the regularisation values of the telescope's \
  sliding joint; here one weight stands for all.
- **Upper part of the telescope.** Table 3 prints its mass; it hangs from a fixed joint and does not enter the motion \
  equations, so no motion shows it.
- **U-turn.** The paper prints neither the control points of its path nor where it lies; length, height, payload and limits \
  are its own, the corners are ours, and so duration and forces depend on them.
- **Fig. 12** is a photograph.";

/// Evaluates all experiments of a campaign; `stage` is called with the name of the next one.
///
/// # Errors
/// If a fit, a plan or an execution fails.
pub fn sections(campaign: &Campaign, stage: &dyn Fn(&str)) -> miette::Result<Vec<Section>> {
    stage("arms and drives");
    let sigma = arms::noise(campaign);
    let table_1 = arms::identify(&campaign.disassembled, &campaign.arms[0], &sigma)?;
    stage("friction curve");
    let points = friction_curve::points(&campaign.constant_speed);
    let curve = friction_curve::fit(&points)
        .ok_or_else(|| miette!("friction-curve: {} points do not determine eq. 48", points.len()))?;
    stage("assembled robot");
    let prior = assembled::prior(&campaign.known, &table_1, &curve);
    let assembled = assembled::identify(campaign, prior, &sigma)?;
    stage("verification");
    let mut all = vec![
        arms::covariance(campaign),
        table_1.section(),
        table_1.verification(&campaign.disassembled, &campaign.arms[1])?,
        friction_curve::section(campaign, &points, &curve),
        assembled.links(campaign),
        assembled.friction(campaign, &table_1),
        verification::torque(campaign, &assembled, &sigma)?,
        verification::strut_forces(campaign, &assembled)?,
        strut_force::section(campaign, &assembled)?,
    ];
    stage("time-optimal motion");
    all.extend(u_turn::sections(campaign, &assembled)?);
    Ok(all)
}

const TITLE: &str = "The paper's experiments on the twin";
const INTRODUCTION: &str = "\
    Gnad, Gattringer, Müller et al., *Identification of physically consistent dynamics parameters of the ABB IRB \
    360-6/1600 delta robot*, sections 6.2 to 6.6, repeated as virtual experiments: the twin is commanded, measured with \
    quantised encoders and noisy torques, and identified from these recordings. Values are estimate ± standard error.";
const LIMITATIONS: &str = "What cannot be compared";

/// The entire page as Markdown.
pub fn markdown(sections: &[Section]) -> String {
    let mut out = format!("# {TITLE}\n\n{INTRODUCTION}\n\n");
    for section in sections {
        out += &section.markdown();
    }
    out += &format!("## {LIMITATIONS}\n\n{LIMITS}\n");
    out
}

/// The entire page, self-contained.
pub fn page(sections: &[Section]) -> Report {
    let mut page = Report::new(TITLE, "");
    let plain = |text: &str| text.replace("**", "").replace('*', "");
    let tables = || sections.iter().flat_map(|s| &s.tables);
    let judged = |(missed, of): (usize, usize), table: &Comparison| {
        let (misses, count) = table.misses(0);
        (missed + misses.len(), of + count)
    };
    let (missed, of) = tables().fold((0, 0), judged);
    let printed = tables().flat_map(|t| &t.rows).filter(|row| row.paper.is_some()).count();
    page.tiles(&[
        [&format!("{} of {of}", of - missed), "estimates within three standard errors", "of the twin's own values"],
        [&printed.to_string(), "quantities beside the paper's", "printed in its tables and text"],
        [&sections.len().to_string(), "of its tables and figures", ""],
    ]);
    page.paragraph(&plain(INTRODUCTION));
    let links: Vec<(String, String)> = sections.iter().map(|s| (s.key.replace('_', "-"), s.title.clone())).collect();
    page.contents(&links);
    sections.iter().for_each(|section| section.add_to(&mut page));
    page.anchored("limits", LIMITATIONS);
    let (text, items) = LIMITS.split_once("\n\n").unwrap_or((LIMITS, ""));
    page.paragraph(&plain(text));
    let items: Vec<String> = items.split("\n").map(|item| plain(item.trim_start_matches("- "))).collect();
    page.list(&items);
    page
}
