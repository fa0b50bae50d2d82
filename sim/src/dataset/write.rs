//! Writing shards: Parquet columns in a fixed order, whole files or none.

use std::{fs::File, io::Write, ops::Range, path::Path, sync::Arc};

use parquet::{
    basic::Compression,
    data_type::{BoolType, ByteArray, ByteArrayType, DataType, FloatType, Int32Type, Int64Type},
    errors::ParquetError,
    file::{
        metadata::KeyValue,
        properties::{EnabledStatistics, WriterProperties},
        writer::{SerializedFileWriter, SerializedRowGroupWriter},
    },
    schema::parser::parse_message_type,
};
use vocaloco_core::heightfield::CELLS;

use super::{DatasetError, Kind, Row};

/// Key of the range of rows that a shard stands for, `from..to`; a cost shard may hold fewer.
pub(super) const ROWS_KEY: &str = "rows";

const COLUMNS: &str = "
    required int64 row;
    required int64 row_seed (INTEGER(64,false));
    required binary terrain (STRING);
    required float size_m;
    required float difficulty;
    required float spawn_x_m;
    required float spawn_y_m;
    required float spawn_z_m;
    required float spawn_yaw_rad;
    required int32 spawn_attempts;
    required group heightfield_m (LIST) { repeated group list { required float element; } }
    required group field_m (LIST) { repeated group list { required float element; } }
    required float label;
    required boolean trainable;
    required int32 rollouts;
    required int32 successes;
    required int32 base_collisions;";
const COST_COLUMNS: &str = "
    required float cot_positive;
    required float cot_signed;
    required binary outcome (STRING);";

/// Writes a shard of rows `range`, whole or not at all.
///
/// # Errors
/// The file system would not.
pub fn write_shard(path: &Path, kind: Kind, range: &Range<u64>, rows: &[Row]) -> Result<(), DatasetError> {
    let bytes = encode(kind, range, rows).map_err(DatasetError::parquet(path))?;
    write_atomically(path, &bytes)
}

/// Writes a file whole or not at all: a hidden file beside it, flushed to disk, then renamed.
///
/// # Errors
/// The file system would not.
pub fn write_atomically(path: &Path, bytes: &[u8]) -> Result<(), DatasetError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let partial = folder.join(format!(".{name}.partial"));
    let write = || {
        let mut file = File::create(&partial)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&partial, path)?;
        // The rename itself reaches the disk with the folder.
        File::open(folder)?.sync_all()
    };
    write().map_err(DatasetError::io(path))
}

fn encode(kind: Kind, range: &Range<u64>, rows: &[Row]) -> Result<Vec<u8>, ParquetError> {
    let cost = if kind == Kind::Cot { COST_COLUMNS } else { "" };
    let schema = Arc::new(parse_message_type(&format!("message row {{ {COLUMNS} {cost} }}"))?);
    let properties = WriterProperties::builder()
        .set_compression(Compression::SNAPPY)
        .set_dictionary_enabled(false)
        .set_statistics_enabled(EnabledStatistics::Chunk)
        .set_key_value_metadata(Some(vec![KeyValue::new(
            ROWS_KEY.to_owned(),
            format!("{}..{}", range.start, range.end),
        )]))
        .build();
    let mut file = SerializedFileWriter::new(Vec::new(), schema, Arc::new(properties))?;
    let mut group = file.next_row_group()?;
    let mut columns = Columns { group: &mut group, rows };
    columns.flat::<Int64Type>(|row| row.row as i64)?;
    columns.flat::<Int64Type>(|row| row.seed as i64)?;
    columns.flat::<ByteArrayType>(|row| ByteArray::from(row.terrain.id()))?;
    columns.flat::<FloatType>(|row| row.size_m)?;
    columns.flat::<FloatType>(|row| row.difficulty)?;
    for part in 0..4 {
        columns.flat::<FloatType>(|row| row.spawn[part])?;
    }
    columns.flat::<Int32Type>(|row| row.spawn_attempts as i32)?;
    columns.cells(|row| &row.heightfield_m)?;
    columns.cells(|row| &row.field_m)?;
    columns.flat::<FloatType>(|row| row.label)?;
    columns.flat::<BoolType>(|row| row.trainable)?;
    columns.flat::<Int32Type>(|row| row.rollouts as i32)?;
    columns.flat::<Int32Type>(|row| row.successes as i32)?;
    columns.flat::<Int32Type>(|row| row.base_collisions as i32)?;
    if kind == Kind::Cot {
        columns.flat::<FloatType>(|row| row.label)?;
        columns.flat::<FloatType>(|row| row.cost.map_or(f32::NAN, |cost| cost.signed))?;
        columns
            .flat::<ByteArrayType>(|row| ByteArray::from(row.cost.map_or("", |cost| cost.outcome.id())))?;
    }
    group.close()?;
    file.into_inner()
}

struct Columns<'a, 'b> {
    group: &'a mut SerializedRowGroupWriter<'b, Vec<u8>>,
    rows: &'a [Row],
}

impl Columns<'_, '_> {
    fn flat<T: DataType>(&mut self, value: impl Fn(&Row) -> T::T) -> Result<(), ParquetError> {
        let values: Vec<T::T> = self.rows.iter().map(value).collect();
        self.write::<T>(&values, None, None)
    }

    /// A list of as many values as the field has cells.
    fn cells(&mut self, cells: impl Fn(&Row) -> &[f32; CELLS]) -> Result<(), ParquetError> {
        let values: Vec<f32> = self.rows.iter().flat_map(|row| *cells(row)).collect();
        let defined = vec![1_i16; values.len()];
        // A value starts a new list where its repetition level is 0.
        let repeated: Vec<i16> = (0..values.len()).map(|k| i16::from(k % CELLS != 0)).collect();
        self.write::<FloatType>(&values, Some(&defined), Some(&repeated))
    }

    fn write<T: DataType>(
        &mut self,
        values: &[T::T],
        defined: Option<&[i16]>,
        repeated: Option<&[i16]>,
    ) -> Result<(), ParquetError> {
        let mut column = self
            .group
            .next_column()?
            .ok_or_else(|| ParquetError::General("more columns than the schema has".to_owned()))?;
        column.typed::<T>().write_batch(values, defined, repeated)?;
        column.close()
    }
}
