//! Reading and merging data sets.

use std::{
    fs::File,
    ops::Range,
    path::{Path, PathBuf},
};

use parquet::{
    column::reader::get_typed_column_reader,
    data_type::{BoolType, ByteArrayType, DataType, FloatType, Int32Type, Int64Type},
    file::{
        metadata::KeyValue,
        reader::{FileReader, RowGroupReader, SerializedFileReader},
    },
};
use sha2::{Digest, Sha256};
use vocaloco_core::heightfield::CELLS;

use super::{DatasetError, Meta, shard_file, write::ROWS_KEY, write_atomically};
use crate::terrain::TerrainKind;

/// A data set in memory, a vector a column, in the order of the rows.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// What it was made of.
    pub meta: Meta,
    /// Number of each row.
    pub rows: Vec<u64>,
    /// The fields as networks see them.
    pub fields: Vec<[f32; CELLS]>,
    /// Viability, or cost of transport.
    pub labels: Vec<f32>,
    /// Whether the row is for training.
    pub trainable: Vec<bool>,
    /// Terrain of each row.
    pub terrain: Vec<TerrainKind>,
    /// Its size, m.
    pub size_m: Vec<f32>,
    /// Rollouts behind each label.
    pub rollouts: Vec<u32>,
    /// Of those, how many reached the horizon.
    pub successes: Vec<u32>,
    /// Poses drawn until one was valid.
    pub spawn_attempts: Vec<u32>,
}

/// Reads a whole data set: the folder that holds `meta.json`.
///
/// # Errors
/// A file is missing or not as it should be.
pub fn read(folder: &Path) -> Result<Dataset, DatasetError> {
    let (dataset, missing) = read_incomplete(folder)?;
    match missing.first() {
        None => Ok(dataset),
        Some(first) => Err(DatasetError::Incomplete {
            path: folder.to_owned(),
            missing: missing.len(),
            wanted: dataset.meta.layout().blocks() as usize,
            first: shard_file(*first),
        }),
    }
}

/// Reads what there is of a data set, and says which blocks are missing.
///
/// # Errors
/// A file is not as it should be.
pub fn read_incomplete(folder: &Path) -> Result<(Dataset, Vec<u64>), DatasetError> {
    let meta = Meta::read(folder)?;
    let mut missing = Vec::new();
    let mut dataset = Dataset {
        meta,
        rows: Vec::new(),
        fields: Vec::new(),
        labels: Vec::new(),
        trainable: Vec::new(),
        terrain: Vec::new(),
        size_m: Vec::new(),
        rollouts: Vec::new(),
        successes: Vec::new(),
        spawn_attempts: Vec::new(),
    };
    let layout = dataset.meta.layout();
    for block in 0..layout.blocks() {
        let path = folder.join(shard_file(block));
        if is_complete(&path, &layout.rows_of(block)) {
            dataset.append(&path)?;
        } else {
            missing.push(block);
        }
    }
    Ok((dataset, missing))
}

/// What a data set's folder holds, by the ends of its files: no more memory for more rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stored {
    /// Rows in shards that are there.
    pub rows: u64,
    /// Shards that are not.
    pub shards_missing: usize,
}

/// Counts what a data set's folder holds.
///
/// # Errors
/// `meta.json` is not as it should be.
pub fn stored(folder: &Path) -> Result<Stored, DatasetError> {
    let layout = Meta::read(folder)?.layout();
    let mut stored = Stored { rows: 0, shards_missing: 0 };
    for block in 0..layout.blocks() {
        match rows_in(&folder.join(shard_file(block)), &layout.rows_of(block)) {
            Some(rows) => stored.rows += rows,
            None => stored.shards_missing += 1,
        }
    }
    Ok(stored)
}

/// Names of a shard's columns, in order.
///
/// # Errors
/// It is not Parquet.
pub fn columns(path: &Path) -> Result<Vec<String>, DatasetError> {
    let file = File::open(path).map_err(DatasetError::io(path))?;
    let reader = SerializedFileReader::new(file).map_err(DatasetError::parquet(path))?;
    let schema = reader.metadata().file_metadata().schema();
    Ok(schema.get_fields().iter().map(|field| field.name().to_owned()).collect())
}

/// Whether a shard is there and stands for exactly these rows.
pub(crate) fn is_complete(path: &Path, rows: &Range<u64>) -> bool {
    rows_in(path, rows).is_some()
}

/// Rows in a shard that is there and stands for exactly these rows.
fn rows_in(path: &Path, rows: &Range<u64>) -> Option<u64> {
    let wanted = format!("{}..{}", rows.start, rows.end);
    let reader = File::open(path).map_err(Into::into).and_then(SerializedFileReader::new).ok()?;
    let metadata = reader.metadata().file_metadata();
    let stands = |pair: &KeyValue| pair.key == ROWS_KEY && pair.value.as_deref() == Some(wanted.as_str());
    metadata.key_value_metadata()?.iter().any(stands).then_some(metadata.num_rows() as u64)
}

/// SHA-256 over `meta.json` and every shard in order, lowercase hex: what a model says it was made of.
///
/// # Errors
/// A file is missing or cannot be read.
pub fn sha256(folder: &Path) -> Result<String, DatasetError> {
    let layout = Meta::read(folder)?.layout();
    let names = std::iter::once(super::META_FILE.to_owned()).chain((0..layout.blocks()).map(shard_file));
    let mut hash = Sha256::new();
    for name in names {
        let path = folder.join(name);
        let bytes = std::fs::read(&path).map_err(DatasetError::io(&path))?;
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    }
    Ok(hash.finalize().iter().fold(String::new(), |text, byte| format!("{text}{byte:02x}")))
}

/// Copies the shards of several data sets into one; all must be made of the same, in all but the
/// number of rows.
///
/// Shards that stand for fewer rows than the merged data set wants of their block are left out.
/// Returns the number of shards copied.
///
/// # Errors
/// A meta differs, a file cannot be read or written, or two data sets disagree about a shard.
pub fn merge(sources: &[PathBuf], target: &Path) -> Result<usize, DatasetError> {
    let metas = sources.iter().map(|folder| Meta::read(folder)).collect::<Result<Vec<_>, _>>()?;
    let Some(mut merged) = metas.first().cloned() else { return Ok(0) };
    for (meta, folder) in metas.iter().zip(sources) {
        merged.check_same(meta, folder)?;
        merged.rows = merged.rows.max(meta.rows);
    }
    std::fs::create_dir_all(target).map_err(DatasetError::io(target))?;
    if target.join(super::META_FILE).exists() {
        let present = Meta::read(target)?;
        merged.check_same(&present, target)?;
        merged.rows = merged.rows.max(present.rows);
    }
    merged.write(target)?;
    let mut copied = 0;
    let layout = merged.layout();
    for block in 0..layout.blocks() {
        let to = target.join(shard_file(block));
        for folder in sources {
            let from = folder.join(shard_file(block));
            let rows = layout.rows_of(block);
            if !is_complete(&from, &rows) {
                continue;
            }
            let bytes = std::fs::read(&from).map_err(DatasetError::io(&from))?;
            if is_complete(&to, &rows) {
                if std::fs::read(&to).map_err(DatasetError::io(&to))? != bytes {
                    let wanted = format!("the bytes of {}", to.display());
                    return Err(DatasetError::content(&from, "shard", "other bytes", wanted));
                }
                continue;
            }
            write_atomically(&to, &bytes)?;
            copied += 1;
        }
    }
    Ok(copied)
}

impl Dataset {
    /// Number of rows.
    pub fn len(&self) -> usize {
        self.labels.len()
    }

    /// Whether there is no row.
    pub fn is_empty(&self) -> bool {
        self.labels.is_empty()
    }

    fn append(&mut self, path: &Path) -> Result<(), DatasetError> {
        let file = File::open(path).map_err(DatasetError::io(path))?;
        let reader = SerializedFileReader::new(file).map_err(DatasetError::parquet(path))?;
        for index in 0..reader.num_row_groups() {
            let group = reader.get_row_group(index).map_err(DatasetError::parquet(path))?;
            let group = Group { reader: group.as_ref(), path };
            let ids = group.column::<ByteArrayType>("terrain")?;
            for id in &ids {
                let id = String::from_utf8_lossy(id.data());
                let kind = TerrainKind::from_id(&id).ok_or_else(|| {
                    DatasetError::content(path, "terrain", format!("{id:?}"), "a terrain's id")
                })?;
                self.terrain.push(kind);
            }
            self.rows.extend(group.column::<Int64Type>("row")?.into_iter().map(|row| row as u64));
            self.labels.extend(group.column::<FloatType>("label")?);
            self.size_m.extend(group.column::<FloatType>("size_m")?);
            self.trainable.extend(group.column::<BoolType>("trainable")?);
            let count = |column: Vec<i32>| column.into_iter().map(|value| value as u32);
            self.rollouts.extend(count(group.column::<Int32Type>("rollouts")?));
            self.successes.extend(count(group.column::<Int32Type>("successes")?));
            self.spawn_attempts.extend(count(group.column::<Int32Type>("spawn_attempts")?));
            let (fields, rest) = {
                let values = group.column::<FloatType>("field_m.list.element")?;
                let (fields, rest) = values.as_chunks::<CELLS>();
                (fields.to_vec(), rest.len())
            };
            if rest != 0 || fields.len() != ids.len() {
                let found = format!("{} whole fields and {rest} cells", fields.len());
                return Err(DatasetError::content(path, "field_m", found, format!("{} fields", ids.len())));
            }
            self.fields.extend(fields);
        }
        Ok(())
    }
}

struct Group<'a> {
    reader: &'a dyn RowGroupReader,
    path: &'a Path,
}

impl Group<'_> {
    fn column<T: DataType>(&self, name: &str) -> Result<Vec<T::T>, DatasetError> {
        let schema = self.reader.metadata().schema_descr();
        let found = schema.columns().iter().position(|column| column.path().string() == name);
        let typed = found
            .filter(|index| self.reader.metadata().column(*index).column_type() == T::get_physical_type());
        let index = typed.ok_or_else(|| {
            DatasetError::content(self.path, name, "no such column of that type", T::get_physical_type())
        })?;
        let read = || {
            let mut column = get_typed_column_reader::<T>(self.reader.get_column_reader(index)?);
            let (mut values, mut defined, mut repeated) = (Vec::new(), Vec::new(), Vec::new());
            let rows = self.reader.metadata().num_rows() as usize;
            while {
                let (records, _, _) =
                    column.read_records(rows, Some(&mut defined), Some(&mut repeated), &mut values)?;
                records > 0
            } {}
            Ok(values)
        };
        read().map_err(DatasetError::parquet(self.path))
    }
}
