//! Arrangement of the views.

use rerun::blueprint as bp;
use rerun::external::re_log_types::{LogMsg, TimeInt};
use rerun::external::re_sdk_types::blueprint::components::{LoopMode, PanelState, PlayState};
use rerun::external::re_sdk_types::blueprint::{archetypes as property, components, datatypes};

use rerun::{AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder};

use super::content::{Level, Scene, Series};
use super::robot::{AFTER, BEFORE};
use super::{APPLICATION, EVENTS, Outcome, TEXT, TIME};

/// Time before and after a failure that is played, s, and how fast.
const FAILURE: ([f64; 2], f64) = ([0.05, 0.15], 0.1);
/// Tab of the curves that show a failure.
const MARGINS: &str = "sockets";

/// The arrangement, and properties of views that a blueprint of the SDK cannot hold.
pub(super) struct Layout {
    blueprint: bp::Blueprint,
    properties: Vec<(EntityPath, Box<dyn AsComponents>)>,
}

impl Layout {
    /// Sends it to the viewer of `rec`.
    pub fn send(&self, rec: &RecordingStream) -> Outcome {
        let (carrier, carried) = RecordingStreamBuilder::new(APPLICATION).memory()?;
        self.blueprint.send(&carrier, bp::BlueprintActivation::default())?;
        let (mut messages, mut command) = (Vec::new(), None);
        for message in carried.take() {
            match message {
                LogMsg::BlueprintActivationCommand(activation) => command = Some(activation),
                own if own.store_id().is_blueprint() => messages.push(own),
                _ => {}
            }
        }
        let command = command.ok_or("the viewer's SDK gives no blueprint")?;
        let (more, added) = RecordingStreamBuilder::from_store_id(&command.blueprint_id).memory()?;
        more.set_time_sequence("blueprint", 0);
        self.properties.iter().try_for_each(|(place, property)| more.log(place.clone(), property.as_ref()))?;
        messages.extend(added.take().into_iter().filter(|message| matches!(message, LogMsg::ArrowMsg(..))));
        rec.send_blueprint(messages, command);
        Ok(())
    }

    /// A view with a property.
    fn with(&mut self, view: impl Into<bp::ContainerLike>, property: impl AsComponents + 'static) -> bp::ContainerLike {
        let view = view.into();
        if let bp::ContainerLike::View(view) = &view {
            let name = std::any::type_name_of_val(&property).rsplit("::").next().unwrap_or_default();
            let place = view.blueprint_path().join(&EntityPath::from(name));
            self.properties.push((place, Box::new(property)));
        }
        view
    }

    /// The curves below `origin`; a single one has its name in the title, several have a legend if it `is_first`.
    fn plot(&mut self, origin: String, curves: &[&Series], is_first: bool) -> bp::ContainerLike {
        let mut lines = curves.iter().flat_map(|s| &s.lines);
        let name = titled(origin.rsplit('/').next().unwrap_or_default());
        let name = match (lines.next(), lines.next()) {
            (Some(only), None) => format!("{name}: {}", only.label),
            _ => name,
        };
        let legend = property::PlotLegend::new()
            .with_visible(is_first && curves.iter().map(|s| s.lines.len()).sum::<usize>() > 1);
        self.with(bp::TimeSeriesView::new(name).with_origin(origin), legend)
    }
}

/// A part of a path in words: `axis1` is `axis 1`.
fn titled(part: &str) -> String {
    let digits = part.trim_start_matches(|c: char| !c.is_ascii_digit());
    format!("{} {digits}", part[..part.len() - digits.len()].replace('_', " ")).trim().into()
}

/// Tab and plot of a curve.
fn place(series: &Series) -> (&str, String) {
    let mut parts = series.path.splitn(3, '/');
    let tab = parts.next().unwrap_or_default();
    match (parts.next(), parts.next()) {
        (Some(plot), Some(_)) => (tab, format!("/{tab}/{plot}")),
        _ => (tab, format!("/{tab}")),
    }
}

/// The groups of `items` with the same `key`, in the order of their first items.
fn grouped<T: Copy, K: PartialEq>(items: impl IntoIterator<Item = T>, key: impl Fn(T) -> K) -> Vec<(K, Vec<T>)> {
    let mut groups: Vec<(K, Vec<T>)> = Vec::new();
    for item in items {
        let key = key(item);
        match groups.iter_mut().find(|(known, _)| *known == key) {
            Some((_, group)) => group.push(item),
            None => groups.push((key, vec![item])),
        }
    }
    groups
}

/// Time of the first failure, s.
fn failure(scene: &Scene) -> Option<f64> {
    scene.notes.iter().find(|note| note.level == Level::Error).map(|note| note.t)
}

/// Tabs with their curves, of a failure the margins first.
fn tabs<'a>(scene: &'a Scene<'_>) -> Vec<(&'a str, Vec<&'a Series>)> {
    let mut tabs = grouped(&scene.series, |s| place(s).0);
    tabs.sort_by_key(|(tab, _)| failure(scene).is_some() && *tab != MARGINS);
    tabs
}

/// Layout: robot and events on the left; one tab per first part of the curves' paths, in it one plot per second part. A
/// failure is shown with the margins first, slowly and again and again.
pub(super) fn layout(scene: &Scene) -> Layout {
    let mut layout = Layout { blueprint: bp::Blueprint::default(), properties: Vec::new() };
    let tabs = tabs(scene).into_iter().map(|(tab, curves)| {
        let plots = grouped(curves, |s| place(s).1).into_iter().enumerate();
        let views: Vec<_> = plots.map(|(k, (origin, curves))| layout.plot(origin, &curves, k == 0)).collect();
        bp::Vertical::new(views).with_name(tab).into()
    });
    let tabs: Vec<bp::ContainerLike> = tabs.collect();
    let mut left = vec![robots(scene)];
    let mut words: Vec<bp::ContainerLike> = Vec::new();
    if scene.eventful || !scene.notes.is_empty() {
        let column = |kind| components::TextLogColumn(datatypes::TextLogColumn { visible: true.into(), kind });
        let kinds = [datatypes::TextLogColumnKind::LogLevel, datatypes::TextLogColumnKind::Body];
        let columns = property::TextLogColumns::new().with_text_log_columns(kinds.map(column));
        words.push(layout.with(bp::TextLogView::new(EVENTS).with_origin(format!("/{EVENTS}")), columns));
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
    let mut time = bp::TimePanel::new().with_timeline(TIME).with_state(PanelState::Collapsed);
    if let (Some(t), [first, .., last]) = (failure(scene), scene.times.as_slice()) {
        let ([before, after], speed) = FAILURE;
        let [from, to] = [t - before, t + after].map(|t| t.max(*first).min(*last));
        let shown = TimeInt::from_secs(from)..=TimeInt::from_secs(to);
        time = time.with_play_state(PlayState::Playing).with_playback_speed(speed);
        time = time.with_loop_mode(LoopMode::Selection).with_time_selection(shown);
    }
    layout.blueprint = bp::Blueprint::new(bp::Horizontal::new(parts))
        .with_auto_views(false)
        .with_blueprint_panel(bp::BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(bp::SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(time);
    layout
}

/// The robot; with a later model a tab for each, so that a click switches between before and after.
fn robots(scene: &Scene) -> bp::ContainerLike {
    let view = |name: &str| bp::Spatial3DView::new(name).with_origin("/world");
    let without = |hidden: &[&str]| {
        let hidden = hidden.iter().map(|root| format!("- /{root}/**"));
        std::iter::once("+ $origin/**".to_string()).chain(hidden).collect::<Vec<_>>()
    };
    match &scene.after {
        None => view("robot").into(),
        Some(after) => bp::Tabs::new([
            view("before").with_contents(without(&[AFTER])).into(),
            view(&format!("after: {}", after.name)).with_contents(without(&BEFORE)).into(),
        ])
        .into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Note, Series};
    use deltatwin::kinematics::{JointState, Motion};
    use deltatwin::machine::Mechanism;
    use rerun::log::Chunk;

    fn curve(path: &str) -> Series {
        Series::new(path.into(), vec![0.0], vec![0.0], [0; 3], "x [N]".into())
    }

    /// Values of the entity that ends in `end`, of every component as text.
    fn of_entity(scene: &Scene, end: &str) -> Vec<String> {
        let (rec, sent) = RecordingStreamBuilder::new(APPLICATION).enabled(true).memory().unwrap();
        layout(scene).send(&rec).unwrap();
        let chunks = sent.take().into_iter().filter_map(|message| match message {
            LogMsg::ArrowMsg(id, arrow) if id.is_blueprint() => Some(Chunk::from_arrow_msg(&arrow).unwrap()),
            _ => None,
        });
        let own = chunks.filter(|chunk| chunk.entity_path().to_string().ends_with(end));
        own.map(|chunk| chunk.components().values().map(|column| format!("{:?}", column.list_array)).collect())
            .collect()
    }

    #[test]
    fn a_failure_is_played_slowly_with_the_margins_first() {
        let file = std::path::Path::new("../../models/irb360-6-1600.toml");
        let geometry = deltatwin_io::model::read(file).unwrap().geometry;
        let poses = Motion::disassembled(&geometry, &JointState::default()).poses();
        let mut scene = Scene::new(Mechanism::default(), &geometry, vec![0.0, 0.3], vec![poses; 2]);
        scene.series = ["torque/axis1/measured", "torque/axis1/model", "torque/axis2/measured", "sockets/margin/all"]
            .map(curve)
            .into();
        let order = |scene: &Scene| tabs(scene).iter().map(|(tab, _)| tab.to_string()).collect::<Vec<_>>();
        assert_eq!(order(&scene), ["torque", "sockets"]);
        assert!(!of_entity(&scene, "time_panel").concat().contains("0.1"));
        scene.notes = vec![Note { t: 0.2, level: Level::Error, text: "dislocation".into() }];
        assert_eq!(order(&scene), ["sockets", "torque"]);
        let time = of_entity(&scene, "time_panel").concat();
        assert!(time.contains("0.1") && time.contains("150000000") && time.contains("300000000"), "{time}");
        // Two curves in the first plot of a tab have a legend, others their name in the title.
        let legends = of_entity(&scene, "PlotLegend");
        assert_eq!(legends.len(), 3);
        assert_eq!(legends.iter().filter(|legend| legend.contains("true")).count(), 1, "{legends:?}");
        assert!(of_entity(&scene, "").concat().contains("axis 2: x [N]"));
    }
}
