//! Arrangement of the views.

use rerun::blueprint as bp;
use rerun::external::re_sdk_types::blueprint::components::PanelState;

use super::content::Scene;
use super::robot::{AFTER, BEFORE};
use super::{EVENTS, TEXT, TIME};

/// Layout: robot and events on the left; one tab per first part of the curves' paths, in it one plot per second part.
pub(super) fn layout(scene: &Scene) -> bp::Blueprint {
    let mut tabs: Vec<(&str, Vec<&str>)> = Vec::new();
    for s in &scene.series {
        let mut parts = s.path.splitn(3, '/');
        let tab = parts.next().unwrap_or_default();
        let plot = match (parts.next(), parts.next()) {
            (Some(plot), Some(_)) => plot,
            _ => "",
        };
        let i = tabs.iter().position(|(name, _)| *name == tab).unwrap_or_else(|| {
            tabs.push((tab, Vec::new()));
            tabs.len() - 1
        });
        if !tabs[i].1.contains(&plot) {
            tabs[i].1.push(plot);
        }
    }
    let tabs = tabs.into_iter().map(|(tab, plots)| {
        let views = plots.into_iter().map(|plot| {
            let (name, origin) = match plot {
                "" => (tab.to_string(), format!("/{tab}")),
                _ => (plot.replace('_', " "), format!("/{tab}/{plot}")),
            };
            bp::ContainerLike::from(bp::TimeSeriesView::new(name).with_origin(origin))
        });
        bp::Vertical::new(views.collect::<Vec<_>>()).with_name(tab).into()
    });
    let tabs: Vec<bp::ContainerLike> = tabs.collect();
    let mut left = vec![robots(scene)];
    let mut words: Vec<bp::ContainerLike> = Vec::new();
    if scene.eventful || !scene.notes.is_empty() {
        words.push(bp::TextLogView::new(EVENTS).with_origin(format!("/{EVENTS}")).into());
    }
    if scene.text.is_some() {
        words.push(bp::TextDocumentView::new(TEXT).with_origin(format!("/{TEXT}")).into());
    }
    match words.len() {
        0 => {}
        1 => left.append(&mut words),
        _ => left.push(bp::Tabs::new(words).into()),
    }
    let mut parts: Vec<bp::ContainerLike> = vec![bp::Vertical::new(left).with_row_shares(vec![3.0, 1.0]).into()];
    if !tabs.is_empty() {
        parts.push(bp::Tabs::new(tabs).into());
    }
    bp::Blueprint::new(bp::Horizontal::new(parts))
        .with_auto_views(false)
        .with_blueprint_panel(bp::BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(bp::SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(bp::TimePanel::new().with_timeline(TIME).with_state(PanelState::Collapsed))
}

/// The robot; with a later model a tab for each, so that a click switches between before and after.
fn robots(scene: &Scene) -> bp::ContainerLike {
    let view = |name: &str| bp::Spatial3DView::new(name).with_origin("/world");
    let without = |hidden: &[&str]| {
        let hidden = hidden.iter().map(|root| format!("- /{root}/**"));
        std::iter::once("+ $origin/**".to_string()).chain(hidden).collect::<Vec<_>>()
    };
    match scene.after {
        None => view("robot").into(),
        Some(_) => bp::Tabs::new([
            view("before").with_contents(without(&[AFTER])).into(),
            view("after: with the later model").with_contents(without(&BEFORE)).into(),
        ])
        .into(),
    }
}
