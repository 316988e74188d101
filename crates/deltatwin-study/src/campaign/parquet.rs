//! Tables as Parquet files: one column per heading, units and origin in the metadata of the file.
//!
//! The bytes of a file are a function of headings, metadata and rows, however the rows arrive.

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, LogicalType, Repetition, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{BoolType, ByteArray, ByteArrayType, DataType, DoubleType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::{Type, TypePtr};

use super::table::{Heading, Kind, Table, Value};

/// Rows per row group; with it the memory that a table takes is bounded.
const GROUP: usize = 4096;
/// Key of the units in the metadata: a JSON object from column to unit.
const UNITS: &str = "units";

/// Writes rows one after the other; a row group is in memory at a time.
pub struct Writer<W: Write + Send> {
    file: SerializedFileWriter<W>,
    headings: Vec<Heading>,
    rows: Vec<Vec<Value>>,
}

impl<W: Write + Send> Writer<W> {
    /// A table with these headings and pairs of metadata, written to `out`.
    ///
    /// # Errors
    /// If `out` fails, or two columns have the same name.
    pub fn new(out: W, headings: &[Heading], metadata: &[(String, String)]) -> Result<Self, ParquetError> {
        let units: serde_json::Map<String, serde_json::Value> =
            headings.iter().filter(|h| !h.unit.is_empty()).map(|h| (h.name.clone(), h.unit.as_str().into())).collect();
        let units = KeyValue::new(UNITS.into(), serde_json::Value::from(units).to_string());
        let pairs = metadata.iter().map(|(key, value)| KeyValue::new(key.clone(), value.clone()));
        let properties = WriterProperties::builder()
            .set_created_by(format!("deltatwin {}", env!("CARGO_PKG_VERSION")))
            .set_compression(Compression::ZSTD(Default::default()))
            .set_statistics_enabled(EnabledStatistics::Chunk)
            .set_key_value_metadata(Some(pairs.chain([units]).collect()))
            .build();
        let file = SerializedFileWriter::new(out, schema(headings)?, Arc::new(properties))?;
        Ok(Self { file, headings: headings.to_vec(), rows: Vec::new() })
    }

    /// Appends a row.
    ///
    /// # Errors
    /// If the output fails, or a value is not of its column's kind.
    pub fn row(&mut self, row: Vec<Value>) -> Result<(), ParquetError> {
        let fits = |(value, heading): (&Value, &Heading)| value.kind().is_none_or(|kind| kind == heading.kind);
        if row.len() != self.headings.len() || !row.iter().zip(&self.headings).all(fits) {
            return Err(ParquetError::General(format!("the row {row:?} does not have the kinds of its columns")));
        }
        self.rows.push(row);
        if self.rows.len() == GROUP { self.group() } else { Ok(()) }
    }

    fn group(&mut self) -> Result<(), ParquetError> {
        let mut group = self.file.next_row_group()?;
        for (c, heading) in self.headings.iter().enumerate() {
            let column = self.rows.iter().map(|row| &row[c]);
            match heading.kind {
                Kind::Float => write_column::<DoubleType, _>(&mut group, column, |v| match v {
                    Value::Float(x) => Some(*x),
                    _ => None,
                }),
                Kind::Integer => write_column::<Int64Type, _>(&mut group, column, |v| match v {
                    Value::Integer(n) => Some(*n),
                    _ => None,
                }),
                Kind::Text => write_column::<ByteArrayType, _>(&mut group, column, |v| match v {
                    Value::Text(text) => Some(ByteArray::from(text.as_str())),
                    _ => None,
                }),
                Kind::Flag => write_column::<BoolType, _>(&mut group, column, |v| match v {
                    Value::Flag(flag) => Some(*flag),
                    _ => None,
                }),
            }?;
        }
        group.close()?;
        self.rows.clear();
        Ok(())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// If the output fails.
    pub fn finish(mut self) -> Result<(), ParquetError> {
        if !self.rows.is_empty() {
            self.group()?;
        }
        self.file.close().map(|_| ())
    }
}

fn schema(headings: &[Heading]) -> Result<TypePtr, ParquetError> {
    for (k, heading) in headings.iter().enumerate() {
        if headings[..k].iter().any(|other| other.name == heading.name) {
            return Err(ParquetError::General(format!("two columns have the name `{}`", heading.name)));
        }
    }
    let field = |heading: &Heading| {
        let (physical, logical) = match heading.kind {
            Kind::Float => (Physical::DOUBLE, None),
            Kind::Integer => (Physical::INT64, None),
            Kind::Text => (Physical::BYTE_ARRAY, Some(LogicalType::String)),
            Kind::Flag => (Physical::BOOLEAN, None),
        };
        Type::primitive_type_builder(&heading.name, physical)
            .with_repetition(Repetition::OPTIONAL)
            .with_logical_type(logical)
            .build()
            .map(Arc::new)
    };
    let fields = headings.iter().map(field).collect::<Result<Vec<_>, _>>()?;
    Ok(Arc::new(Type::group_type_builder("runs").with_fields(fields).build()?))
}

fn write_column<'v, T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    column: impl Iterator<Item = &'v Value>,
    value: impl Fn(&Value) -> Option<T::T>,
) -> Result<(), ParquetError> {
    let (mut values, mut present) = (Vec::new(), Vec::new());
    for cell in column {
        let cell = value(cell);
        present.push(i16::from(cell.is_some()));
        values.extend(cell);
    }
    let mut writer = group.next_column()?.ok_or_else(|| ParquetError::General("the schema lacks a column".into()))?;
    writer.typed::<T>().write_batch(&values, Some(&present), None)?;
    writer.close()
}

/// Reads a table row group by row group.
pub struct Reader {
    file: SerializedFileReader<File>,
    headings: Vec<Heading>,
    metadata: Vec<(String, String)>,
}

impl Reader {
    /// The table in the file at `path`.
    ///
    /// # Errors
    /// If the file cannot be read or is no table that [`Writer`] has written.
    pub fn open(path: &Path) -> Result<Self, ParquetError> {
        let file = SerializedFileReader::new(File::open(path)?)?;
        let about = file.metadata().file_metadata();
        let pairs = about.key_value_metadata().map_or(&[][..], Vec::as_slice);
        let mut metadata: Vec<(String, String)> =
            pairs.iter().map(|pair| (pair.key.clone(), pair.value.clone().unwrap_or_default())).collect();
        let units = metadata.iter().position(|(key, _)| key == UNITS).map(|at| metadata.remove(at).1);
        let units: serde_json::Map<String, serde_json::Value> =
            units.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default();
        let heading = |column: &parquet::schema::types::ColumnDescPtr| {
            let kind = match column.physical_type() {
                Physical::DOUBLE => Kind::Float,
                Physical::INT64 => Kind::Integer,
                Physical::BYTE_ARRAY => Kind::Text,
                Physical::BOOLEAN => Kind::Flag,
                other => return Err(ParquetError::General(format!("`{}` has the type {other}", column.name()))),
            };
            let unit = units.get(column.name()).and_then(|unit| unit.as_str()).unwrap_or_default();
            Ok(Heading::new(column.name(), unit, kind))
        };
        let headings = about.schema_descr().columns().iter().map(heading).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { file, headings, metadata })
    }

    /// Headings.
    pub fn headings(&self) -> &[Heading] {
        &self.headings
    }

    /// The pairs of metadata that the writer was given.
    pub fn metadata(&self) -> &[(String, String)] {
        &self.metadata
    }

    /// Number of row groups.
    pub fn groups(&self) -> usize {
        self.file.num_row_groups()
    }

    /// Number of rows.
    pub fn len(&self) -> u64 {
        self.file.metadata().file_metadata().num_rows().unsigned_abs()
    }

    /// Whether the table has no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The rows of one row group.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn group(&self, group: usize) -> Result<Vec<Vec<Value>>, ParquetError> {
        let group = self.file.get_row_group(group)?;
        let count = usize::try_from(group.metadata().num_rows()).unwrap_or_default();
        let mut rows = vec![Vec::with_capacity(self.headings.len()); count];
        for c in 0..self.headings.len() {
            let cells = match group.get_column_reader(c)? {
                ColumnReader::DoubleColumnReader(reader) => read_column(reader, count, Value::Float)?,
                ColumnReader::Int64ColumnReader(reader) => read_column(reader, count, Value::Integer)?,
                ColumnReader::BoolColumnReader(reader) => read_column(reader, count, Value::Flag)?,
                ColumnReader::ByteArrayColumnReader(reader) => read_column(reader, count, |bytes: ByteArray| {
                    Value::Text(String::from_utf8_lossy(bytes.data()).into_owned())
                })?,
                _ => return Err(ParquetError::General("a column of another type".into())),
            };
            for (row, cell) in rows.iter_mut().zip(cells) {
                row.push(cell);
            }
        }
        Ok(rows)
    }

    /// The whole table.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub fn table(&self) -> Result<Table, ParquetError> {
        let mut table = Table { headings: self.headings.clone(), rows: Vec::new() };
        for group in 0..self.groups() {
            table.rows.extend(self.group(group)?);
        }
        Ok(table)
    }
}

fn read_column<T: DataType>(
    mut reader: ColumnReaderImpl<T>,
    count: usize,
    cell: impl Fn(T::T) -> Value,
) -> Result<Vec<Value>, ParquetError> {
    let (mut values, mut present) = (Vec::new(), Vec::new());
    while present.len() < count {
        let (records, _, _) = reader.read_records(count - present.len(), Some(&mut present), None, &mut values)?;
        if records == 0 {
            return Err(ParquetError::General("a column ends early".into()));
        }
    }
    let mut values = values.into_iter();
    Ok(present
        .into_iter()
        .map(|there| if there == 1 { values.next().map_or(Value::Missing, &cell) } else { Value::Missing })
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn headings() -> Vec<Heading> {
        vec![
            Heading::new("run", "1", Kind::Integer),
            Heading::new("mass", "kg", Kind::Float),
            Heading::new("cause", "", Kind::Text),
            Heading::new("survived", "", Kind::Flag),
        ]
    }

    fn row(i: i64) -> Vec<Value> {
        let mass = if i % 7 == 0 { Value::Missing } else { Value::Float(0.1 * i as f64) };
        let cause = if i % 5 == 0 { Value::Missing } else { format!("Ursache {} µ", i % 3).into() };
        vec![i.into(), mass, cause, (i % 2 == 0).into()]
    }

    fn bytes(rows: i64) -> Vec<u8> {
        let mut out = Vec::new();
        let mut writer = Writer::new(&mut out, &headings(), &[("seed".into(), "1".into())]).unwrap();
        (0..rows).for_each(|i| writer.row(row(i)).unwrap());
        writer.finish().unwrap();
        out
    }

    #[test]
    fn rows_come_back_bit_by_bit() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("runs.parquet");
        for rows in [0, 1, 4096, 9000] {
            std::fs::write(&file, bytes(rows)).unwrap();
            let reader = Reader::open(&file).unwrap();
            assert_eq!((reader.len(), reader.is_empty()), (rows as u64, rows == 0));
            assert_eq!(reader.metadata(), [("seed".to_string(), "1".to_string())]);
            let table = reader.table().unwrap();
            assert_eq!(table.headings, headings());
            assert_eq!(table.rows, (0..rows).map(row).collect::<Vec<_>>());
            assert_eq!(reader.groups(), (rows as usize).div_ceil(GROUP));
        }
        assert_eq!(bytes(5000), bytes(5000));
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let mut writer = Writer::new(Vec::new(), &headings(), &[]).unwrap();
        assert!(writer.row(vec![Value::Float(0.0), Value::Missing, Value::Missing, Value::Missing]).is_err());
        assert!(writer.row(vec![Value::Missing]).is_err());
        let twice = [Heading::new("a", "", Kind::Text), Heading::new("a", "", Kind::Text)];
        assert!(Writer::new(Vec::new(), &twice, &[]).is_err());
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("runs.parquet");
        for damaged in [Vec::new(), b"PAR1".to_vec(), bytes(10)[..100].to_vec()] {
            std::fs::write(&file, damaged).unwrap();
            assert!(Reader::open(&file).is_err());
        }
    }
}
