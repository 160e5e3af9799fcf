//! Features of vertices as parts of a model: objects with names and attributes.

use std::collections::BTreeMap;

use super::super::model_file::ModelFile;
use super::super::parts::PartNames;
use super::buffers::Buffers;
use super::meshes::{Features, Primitive};
use super::property_tables::{PropertyTable, PropertyTables};
use spinney_base::{Error, Result};
use spinney_brep::Attributes;

/// Approximate memory of a feature.
const FEATURE: u64 = 64;

/// Use of a mesh by a node.
#[derive(Clone, Copy, Debug)]
pub(super) struct MeshUse {
    pub(super) number: u32,
    /// Number of previous nodes with the same mesh.
    pub(super) copy: u32,
}

/// Scope in which identifiers are unique: a table and the number of previous nodes with the same
/// mesh, or a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Scope {
    Table(u32, u32),
    Node(u32),
}

impl Scope {
    fn of(features: &Features, node: MeshUse) -> Scope {
        features.table.map_or(Scope::Node(node.number), |table| Scope::Table(table, node.copy))
    }
}

/// Parts of features. Those of one row of a table are one part, also in several primitives and
/// nodes. If nodes share a mesh, each has its own parts.
#[derive(Default)]
pub(super) struct FeatureParts {
    parts: BTreeMap<(Scope, u64), u32>,
}

impl FeatureParts {
    /// Returns the part of a feature, if it is one that has been added.
    pub(super) fn part(&self, features: &Features, node: MeshUse, id: u64) -> Option<u32> {
        self.parts.get(&(Scope::of(features, node), id)).copied()
    }

    /// Adds the features of all vertices of a node. Returns whether there are vertices without one.
    ///
    /// # Errors
    /// If there are more than fit into `memory` bytes.
    pub(super) fn add(
        &mut self,
        source: &ModelFile,
        buffers: &Buffers,
        (node, primitives): (MeshUse, &[Primitive]),
        memory: u64,
    ) -> Result<bool> {
        let mut is_whole = true;
        for primitive in primitives {
            let Some(features) = &primitive.features else {
                is_whole = false;
                continue;
            };
            let (scope, ids) = (Scope::of(features, node), features.ids.reader(source, buffers));
            let mut last = None;
            for vertex in 0..ids.len() {
                let id = features.get(&ids, vertex);
                if last.replace(id) == Some(id) {
                    continue;
                }
                match id {
                    Some(id) => _ = self.parts.insert((scope, id), 0),
                    None => is_whole = false,
                }
            }
            let (needed, limit) = (self.parts.len() as u64 * FEATURE, memory.max(1 << 20));
            if needed > limit {
                return Err(Error::TooLarge {
                    path: source.path().to_path_buf(),
                    what: "the list of features".into(),
                    needed,
                    limit,
                    advice: "allow more memory, or split the file".into(),
                });
            }
        }
        Ok(!is_whole)
    }

    /// Numbers the features, and adds their names and attributes: those of tables, or the name of
    /// the node. Returns the number of columns that were not read.
    ///
    /// # Errors
    /// If a table is corrupt or has no such row, or if memory is not enough.
    pub(super) fn describe(
        &mut self,
        (source, buffers): (&ModelFile, &Buffers),
        tables: &PropertyTables,
        node_name: &dyn Fn(usize) -> Result<String>,
        (names, attributes): (&mut PartNames, &mut Attributes),
    ) -> Result<u64> {
        let (mut unread, mut open) = (0, None::<(u32, PropertyTable<'_>)>);
        for ((scope, id), part) in &mut self.parts {
            *part = names.len();
            let (number, copy) = match *scope {
                Scope::Table(number, copy) => (number, copy),
                Scope::Node(node) => {
                    names.push(source, format!("{} {id}", node_name(node as usize)?))?;
                    continue;
                }
            };
            let table = match open.take().filter(|(open, _)| *open == number) {
                Some((_, table)) => table,
                None => {
                    let table = tables.table(source, buffers, number)?;
                    unread += table.unread;
                    table
                }
            };
            if *id >= table.count {
                let found = format!("feature {id} of {}", table.count);
                return Err(source.corrupt(format!("property table {number}"), found, "a row of the table"));
            }
            let name = table.name(*id);
            names.push(source, if copy == 0 { name } else { format!("{name} #{}", copy + 1) })?;
            let about = table.attributes(*id);
            if !about.is_empty() {
                attributes.push_part(source.path(), *part, about.to_string())?;
            }
            open = Some((number, table));
        }
        Ok(unread)
    }
}
