//! Verdicts as rows of a table.

use super::verdict::{CauseKind, Touchdown, Verdict};
use crate::campaign::{Column, Value};
use deltatwin::twin::sockets::socket_name;

/// Columns of [`Verdict::row`].
const COLUMNS: &[Column] = &[
    Column::flag("survived"),
    Column::text("cause"),
    Column::text("part"),
    Column::float("cause_time", "s"),
    Column::text("first_limit"),
    Column::text("first_limit_part"),
    Column::float("first_limit_time", "s"),
    Column::float("failure_time", "s"),
    Column::float("margin", "1"),
    Column::float("margin_socket", "1"),
    Column::float("margin_torque", "1"),
    Column::float("margin_speed", "1"),
    Column::float("margin_telescope", "1"),
    Column::float("margin_workspace", "1"),
    Column::float("margin_contact", "1"),
    Column::float("margin_trip", "1"),
    Column::float("margin_following", "1"),
    Column::text("first_socket"),
    Column::integer("sockets_at_once", "1"),
    Column::integer("sockets_open", "1"),
    Column::float("failure_energy", "J"),
    Column::float("platform_lands", "s"),
    Column::float("platform_x", "m"),
    Column::float("platform_y", "m"),
    Column::float("platform_z", "m"),
    Column::float("platform_energy", "J"),
    Column::float("payload_lands", "s"),
    Column::float("payload_x", "m"),
    Column::float("payload_y", "m"),
    Column::float("payload_z", "m"),
    Column::float("payload_energy", "J"),
    Column::text("noticed_by"),
    Column::float("lead", "s"),
    Column::float("strut_force", "N"),
    Column::float("hand_torque", "N·m"),
    Column::float("hand_force", "N"),
    Column::float("hand_margin", "1"),
    Column::float("cycle", "s"),
    Column::float("picks_per_minute", "1/min"),
];

impl Verdict {
    /// Columns of the table that rows of verdicts form.
    pub fn columns() -> &'static [Column] {
        COLUMNS
    }

    /// Row under [`Self::columns`].
    pub fn row(&self) -> Vec<Value> {
        let mut row: Vec<Value> = vec![
            self.survived.into(),
            self.cause.kind.name().into(),
            self.cause.part.as_str().into(),
            self.cause.time.into(),
            self.limit.as_ref().map(|limit| limit.kind.name().to_string()).into(),
            self.limit.as_ref().map(|limit| limit.part.clone()).into(),
            self.limit.as_ref().map(|limit| limit.time).into(),
            self.time.into(),
            self.margin.into(),
        ];
        row.extend(CauseKind::ALL.map(|kind| self.margin_of(kind).into()));
        let opened = (self.opened_at_once(), self.opened.len());
        row.extend([
            self.opened.first().map(|&(_, socket)| socket_name(socket, self.sockets.len() / 2)).into(),
            (opened.0 as i64).into(),
            (opened.1 as i64).into(),
            self.energy.into(),
        ]);
        row.extend(touchdown(self.platform.as_ref()));
        row.extend(touchdown(self.payload.as_ref()));
        let hand = self.hand.as_ref();
        row.extend([
            if self.survived { Value::Missing } else { self.fmea.detection.as_str().into() },
            self.fmea.lead.into(),
            self.strut_force.into(),
            hand.map(|h| h.torque).into(),
            hand.map(|h| h.force).into(),
            hand.map(|h| h.margin).into(),
            self.cycle.into(),
            self.picks_per_minute().into(),
        ]);
        row
    }
}

/// Time, place and energy of a touchdown.
fn touchdown(at: Option<&Touchdown>) -> [Value; 5] {
    let number = |of: fn(&Touchdown) -> f64| at.map(of).into();
    [
        number(|t| t.time),
        number(|t| t.position[0]),
        number(|t| t.position[1]),
        number(|t| t.position[2]),
        number(|t| t.energy),
    ]
}
