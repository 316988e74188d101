//! Recordings as Parquet files, for polars, pandas, DuckDB and other readers of tables.

use std::io::Write;

use deltatwin::recording::Recording;
use deltatwin_io::recording::setup;
use parquet::errors::ParquetError;

use crate::campaign::parquet::Writer;
use crate::campaign::{Heading, Kind, Value};

/// Writes a recording to `out`, a row per sample and a column per channel, named as in CSV files.
///
/// The metadata hold the unit of every column (`units`, JSON), the setup (`setup`, TOML), the name, and the instant of t =
/// 0 (`start_ns`, ns since 1970) if it is known. A value that is missing in a channel that the recording has is null.
///
/// # Errors
/// If `out` fails.
pub fn write(recording: &Recording, out: impl Write + Send) -> Result<(), ParquetError> {
    let columns = recording.signals.columns();
    let headings: Vec<Heading> =
        columns.iter().map(|(name, unit, _)| Heading::new(name.clone(), unit.to_string(), Kind::Float)).collect();
    let start = recording.signals.start.map(|start| ("start_ns".to_string(), start.to_string()));
    let own = [("name", recording.name.clone()), ("setup", setup::to_toml(&recording.setup))];
    let metadata: Vec<_> = own.into_iter().map(|(k, v)| (k.to_string(), v)).chain(start).collect();
    let mut writer = Writer::new(out, &headings, &metadata)?;
    for i in 0..recording.signals.len() {
        let value = |x: f64| if x.is_finite() { Value::Float(x) } else { Value::Missing };
        writer.row(columns.iter().map(|(_, _, values)| value(values[i])).collect())?;
    }
    writer.finish()
}

#[cfg(test)]
mod tests {
    use deltatwin::machine::Joint;
    use deltatwin::recording::Signals;

    use super::*;
    use crate::campaign::parquet::Reader;

    #[test]
    fn every_sample_comes_back_bit_by_bit_with_units_and_setup() {
        let rows = [[0.0, 0.1, 1.0], [4e-4, 0.1 + 1e-16, f64::MIN_POSITIVE], [8e-4, -3.0, -0.0]];
        let mut signals = Signals::of_axis(Joint::Revolute, &rows);
        signals.start = Some(1_700_000_000_000_000_000);
        let recording = Recording { name: "run".into(), signals, setup: Default::default() };
        let mut bytes = Vec::new();
        write(&recording, &mut bytes).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.parquet");
        std::fs::write(&file, bytes).unwrap();
        let reader = Reader::open(&file).unwrap();
        let names: Vec<(&str, &str)> = reader.headings().iter().map(|h| (&*h.name, &*h.unit)).collect();
        assert_eq!(names, [("t", "s"), ("q1", "rad"), ("tau1", "N·m")]);
        let has = |key: &str, value: &str| reader.metadata().iter().any(|(k, v)| k == key && v.contains(value));
        assert!(has("name", "run") && has("setup", "assembled") && has("start_ns", "1700000000000000000"));
        let table = reader.table().unwrap();
        for (column, (_, _, expected)) in recording.signals.columns().iter().enumerate() {
            let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&table.numbers(column)), bits(expected), "column {column}");
        }
    }
}
