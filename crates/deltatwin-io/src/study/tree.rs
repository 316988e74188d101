//! Places in a tree of TOML values, by dotted names.

use deltatwin::text::nearest;
use toml::{Table, Value};

use super::factor::Change;

/// Names of the entries of an array of three or four numbers.
const COORDINATES: [&str; 4] = ["x", "y", "z", "psi"];

/// Changes the value at `key` of `tree` by `value`; tables that are missing on the way are made.
///
/// A step of the key is a name of a table, an entry of an array from 1, a coordinate `x`, `y`, `z` or `psi`, or the
/// `name` of a table in an array. A number that meets an array changes all its numbers.
pub fn change(tree: &mut Table, key: &str, value: &Value, change: Change) -> Result<(), String> {
    let mut steps: Vec<&str> = key.split('.').collect();
    let last = steps.pop().unwrap_or(key);
    let mut node = Node::Table(tree);
    let mut path = String::new();
    for step in steps {
        node = match node {
            Node::Table(table) => {
                Node::of(table.entry(step).or_insert_with(|| Value::Table(Table::new())), &path, step)?
            }
            Node::Array(items) => {
                let index = entry(items, step, &path)?;
                Node::of(&mut items[index], &path, step)?
            }
        };
        path = joined(&path, step);
    }
    match node {
        Node::Array(items) => {
            let index = entry(items, last, &path)?;
            items[index] = changed(Some(&items[index]), value, change, key)?;
        }
        Node::Table(table) => {
            let new = changed(table.get(last), value, change, key)?;
            table.insert(last.into(), new);
        }
    }
    Ok(())
}

/// A table or an array on the way to a value.
enum Node<'t> {
    Table(&'t mut Table),
    Array(&'t mut Vec<Value>),
}

impl<'t> Node<'t> {
    fn of(value: &'t mut Value, path: &str, step: &str) -> Result<Self, String> {
        match value {
            Value::Table(table) => Ok(Self::Table(table)),
            Value::Array(items) => Ok(Self::Array(items)),
            other => Err(format!("`{}` is {other}, which has no parts", joined(path, step))),
        }
    }
}

fn joined(path: &str, step: &str) -> String {
    if path.is_empty() { step.into() } else { format!("{path}.{step}") }
}

/// Index of the entry of an array that a step of a key names.
fn entry(items: &[Value], step: &str, path: &str) -> Result<usize, String> {
    let names: Vec<&str> = items.iter().filter_map(|item| item.as_table()?.get("name")?.as_str()).collect();
    if let Some(index) = items.iter().position(|item| {
        item.as_table().and_then(|table| table.get("name")).and_then(Value::as_str).is_some_and(|name| name == step)
    }) {
        return Ok(index);
    }
    let number = match COORDINATES.iter().position(|name| *name == step) {
        Some(index) if names.is_empty() => Some(index + 1),
        _ => step.parse().ok(),
    };
    match number {
        Some(number) if (1..=items.len()).contains(&number) => Ok(number - 1),
        _ if names.is_empty() => {
            Err(format!("`{path}` has no entry `{step}`; expected a number from 1 to {}", items.len()))
        }
        _ => {
            let hint = nearest(step, names.iter().copied()).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
            Err(format!("`{path}` has nothing called `{step}`; expected one of {}{hint}", names.join(", ")))
        }
    }
}

/// The value `old` after a change.
fn changed(old: Option<&Value>, value: &Value, change: Change, key: &str) -> Result<Value, String> {
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|n| n as f64));
    // A number for every entry, however deep.
    if let (Some(Value::Array(items)), Some(_)) = (old, number(value)) {
        let all: Result<Vec<Value>, String> =
            items.iter().map(|item| changed(Some(item), value, change, key)).collect();
        return all.map(Value::Array);
    }
    if change == Change::Set {
        // A whole number stays one, for keys that take no other.
        return Ok(match (old, value) {
            (Some(Value::Integer(_)), Value::Float(x)) if x.fract() == 0.0 && x.abs() < 1e15 => {
                Value::Integer(*x as i64)
            }
            _ => value.clone(),
        });
    }
    let Some(old) = old else {
        return Err(format!(
            "`{key}` is not there, so that it cannot be changed relative to its value; expected it to be"
        ));
    };
    match (number(old), number(value), change) {
        (Some(old), Some(value), Change::Multiply) => Ok(Value::Float(old * value)),
        (Some(old), Some(value), _) => Ok(Value::Float(old + value)),
        _ => Err(format!("`{key}` is {old}; expected a number, or numbers")),
    }
}

/// A value on one line.
pub fn text(value: &Value) -> String {
    match value {
        Value::String(text) => text.clone(),
        Value::Array(items) => format!("[{}]", items.iter().map(text).collect::<Vec<_>>().join(", ")),
        Value::Table(table) => {
            let entries: Vec<String> = table.iter().map(|(key, value)| format!("{key} = {}", text(value))).collect();
            format!("{{ {} }}", entries.join(", "))
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TREE: &str = "seed = 3\n[payload]\nmass = 2\ncom = [0.1, 0.2, 0.3]\n[motion]\nwaypoints = [[0, 0, -1, 0], [1, 0, \
                        -1, 0]]\n[[objects]]\nname = \"table\"\nposition = [0.0, 0.0, -1.0]\n[[objects]]\nname = \"block\"\n";

    fn after(key: &str, value: impl Into<Value>, how: Change) -> Result<Table, String> {
        let mut tree: Table = TREE.parse().unwrap();
        change(&mut tree, key, &value.into(), how).map(|()| tree)
    }

    #[test]
    fn values_are_reached_by_name_number_and_coordinate() {
        let set = |key: &str| after(key, 7.0, Change::Set).unwrap();
        assert_eq!(set("payload.mass")["payload"]["mass"], Value::Integer(7));
        assert_eq!(set("payload.com.y")["payload"]["com"][1], Value::Float(7.0));
        assert_eq!(set("payload.com.2")["payload"]["com"][1], Value::Float(7.0));
        assert_eq!(set("objects.table.position.z")["objects"][0]["position"][2], Value::Float(7.0));
        assert_eq!(set("motion.waypoints.2.psi")["motion"]["waypoints"][1][3], Value::Integer(7));
        assert_eq!(set("supervision.torque")["supervision"]["torque"], Value::Float(7.0));
        assert_eq!(set("payload.com")["payload"]["com"], Value::Array(vec![Value::Float(7.0); 3]));
        assert_eq!(after("seed", 2.5, Change::Set).unwrap()["seed"], Value::Float(2.5));
        let doubled = after("payload.com", 2.0, Change::Multiply).unwrap();
        assert_eq!(doubled["payload"]["com"], Value::Array([0.2, 0.4, 0.6].map(Value::Float).to_vec()));
        let more = after("payload.mass", 0.5, Change::Add).unwrap();
        assert_eq!(more["payload"]["mass"], Value::Float(2.5));
    }

    #[test]
    fn places_that_are_not_there_are_named() {
        for (key, expected) in [
            (
                "objects.tabel.yaw",
                "`objects` has nothing called `tabel`; expected one of table, block; did you mean `table`?",
            ),
            ("payload.com.4", "`payload.com` has no entry `4`; expected a number from 1 to 3"),
            ("payload.com.0", "has no entry `0`"),
            ("payload.mass.x", "`payload.mass` is 2, which has no parts"),
        ] {
            let e = after(key, 1.0, Change::Set).unwrap_err();
            assert!(e.contains(expected), "{e}");
        }
        assert!(after("payload.radius", 2.0, Change::Multiply).unwrap_err().contains("`payload.radius` is not there"));
        assert!(after("objects.table.name", 2.0, Change::Add).unwrap_err().contains("is \"table\"; expected a number"));
    }
}
