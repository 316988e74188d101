//! A comparison as JSON.

use serde_json::{Map, Value, json};

use crate::gate;
use crate::json::{channel_names, insert_channels, insert_held_out, repeats};
use deltatwin::comparison::{Comparison, Finding};

/// The comparison as a JSON object, with what the gate said about its recordings.
pub fn json(c: &Comparison, findings: &[deltatwin::gate::Finding]) -> Value {
    let mut object = Map::new();
    object.insert("channels".into(), channel_names(&c.channels));
    insert_channels(&mut object, "rms", &c.channels, &c.rms);
    insert_channels(&mut object, "noise_floor", &c.channels, &c.noise_floor);
    insert_held_out(&mut object, &c.channels, c.held_out.as_ref());
    object.insert("repeats".into(), repeats(c.repeats.as_ref()));
    let finding = |f: &Finding| {
        json!({
            "axis": f.channel.drive().map(|i| i + 1),
            "channel": f.channel.to_string(),
            "where": f.place,
            "share": f.share,
            "sentence": f.sentence,
        })
    };
    object.insert("findings".into(), c.findings.iter().map(finding).collect());
    object.insert("gate".into(), gate::json(findings));
    Value::Object(object)
}
