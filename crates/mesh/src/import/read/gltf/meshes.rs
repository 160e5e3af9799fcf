//! Primitives of meshes: triangles, and colours of their corners.

use std::collections::BTreeSet;

use super::super::corners::WHITE;
use super::super::model_file::ModelFile;
use super::accessors::{Elements, Purpose, Reader};
use super::buffers::Buffers;
use super::document::{self, Document, FeatureIds, item};
use super::losses::Losses;
use spinney_base::{Error, Result};

/// Triangles of a mesh with one material.
pub(super) struct Primitive {
    pub(super) positions: Elements,
    indices: Option<Elements>,
    colours: Option<Elements>,
    pub(super) features: Option<Features>,
    /// Linear base colour of the material, by which colours of vertices are multiplied.
    factor: [f32; 3],
    order: Order,
    /// Whether there is a triangle with three distinct corners. Others are not passed on, so that a
    /// mesh without any, at millions of instances, would be read without a check for cancellation.
    pub(super) has_faces: bool,
}

/// Features of a primitive's vertices.
pub(super) struct Features {
    pub(super) ids: Elements,
    pub(super) table: Option<u32>,
    /// Identifier of vertices without a feature.
    null: Option<u64>,
}

impl Features {
    /// Returns the feature of a vertex.
    pub(super) fn get(&self, ids: &Reader<'_>, vertex: u64) -> Option<u64> {
        Some(ids.integer(vertex)).filter(|id| Some(*id) != self.null)
    }
}

/// Callback for each triangle: its corners, their colours if the model has colours, and the
/// feature of its first corner.
pub(super) type TriangleVisitor<'a> =
    dyn FnMut([[f64; 3]; 3], Option<[[u8; 3]; 3]>, Option<u64>) -> Result<()> + 'a;

/// Order of the corners of triangles.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Triangles,
    Strip,
    Fan,
}

impl Order {
    /// Number of triangles of a list of corners.
    fn count(self, corners: u64) -> u64 {
        match self {
            Order::Triangles => corners / 3,
            Order::Strip | Order::Fan => corners.saturating_sub(2),
        }
    }

    /// Corners of a triangle, counterclockwise.
    #[inline]
    fn corners(self, triangle: u64) -> [u64; 3] {
        match self {
            Order::Triangles => [0, 1, 2].map(|corner| 3 * triangle + corner),
            Order::Strip if triangle.is_multiple_of(2) => [0, 1, 2].map(|corner| triangle + corner),
            Order::Strip => [0, 2, 1].map(|corner| triangle + corner),
            Order::Fan => [0, triangle + 1, triangle + 2],
        }
    }
}

/// Accessors of a primitive with triangles and positions.
struct Source<'a> {
    primitive: &'a document::Primitive,
    positions: u32,
    features: Option<FeatureSource>,
    order: Order,
}

/// Feature identifiers that are read.
#[derive(Clone, Copy)]
struct FeatureSource {
    accessor: u32,
    table: Option<u32>,
    null: Option<u64>,
}

/// Primitives of a mesh that are read. The others are counted.
fn primitives<'a>(
    source: &ModelFile,
    document: &'a Document<'_>,
    mesh: u32,
    losses: &mut Losses,
) -> Result<Vec<Source<'a>>> {
    let mut all = Vec::new();
    for (number, primitive) in
        item(source, &document.meshes, ("mesh", mesh), &"nodes")?.primitives.iter().enumerate()
    {
        let place = format!("mesh {mesh}, primitive {number}");
        let order = match primitive.mode.unwrap_or(4) {
            0..=3 => {
                losses.lines += 1;
                continue;
            }
            4 => Order::Triangles,
            5 => Order::Strip,
            6 => Order::Fan,
            mode => return Err(source.corrupt(place, format!("mode {mode}"), "a mode from 0 to 6")),
        };
        let Some(positions) = primitive.attributes.position else {
            losses.unplaced += 1;
            continue;
        };
        let extensions = primitive.extensions.as_ref();
        let accessor = item(source, &document.accessors, ("accessor", positions), &place)?;
        let is_draco = extensions.is_some_and(|extensions| extensions.draco.is_some());
        // (Some files have uncompressed copies, too.)
        if is_draco && accessor.buffer_view.is_none() {
            return Err(draco(source));
        }
        losses.targets += u64::from(!primitive.targets.is_empty());
        let sets = extensions.and_then(|extensions| extensions.features.as_ref());
        let features = objects(document, sets.map_or(&[], |sets| &sets.feature_ids[..]), primitive);
        losses.features +=
            u64::from(sets.is_some_and(|sets| features.is_none() || sets.feature_ids.len() > 1));
        all.push(Source { primitive, positions, features, order });
    }
    Ok(all)
}

/// Returns the feature identifiers that are objects: the first set that is an attribute of
/// vertices, or else `_BATCHID`, the attribute that preceded these sets.
fn objects(
    document: &Document<'_>,
    sets: &[FeatureIds],
    primitive: &document::Primitive,
) -> Option<FeatureSource> {
    let found = sets.iter().find_map(|set| Some((set, primitive.attributes.feature_ids(set.attribute?)?)));
    match found {
        // (Features of our exported cells are classes, of one surface.)
        Some((set, _)) if document.is_own() && set.label.as_deref() == Some("classes") => None,
        Some((set, accessor)) => {
            Some(FeatureSource { accessor, table: set.property_table, null: set.null_feature_id })
        }
        None => {
            primitive.attributes.batch.map(|accessor| FeatureSource { accessor, table: None, null: None })
        }
    }
}

/// Error of compressed triangles that are not supported.
pub(super) fn draco(source: &ModelFile) -> Error {
    let advice = "write the model without Draco compression, for example with `gltf-transform copy IN OUT`";
    Error::unsupported(source.path(), "glTF with KHR_draco_mesh_compression", advice)
}

/// Adds the accessors that a mesh uses.
pub(super) fn add_accessors(
    source: &ModelFile,
    document: &Document<'_>,
    mesh: u32,
    accessors: &mut BTreeSet<u32>,
) -> Result<()> {
    for Source { primitive, positions, features, .. } in
        primitives(source, document, mesh, &mut Losses::default())?
    {
        accessors.insert(positions);
        accessors.extend(features.map(|features| features.accessor));
        accessors.extend(primitive.indices);
        accessors.extend(primitive.attributes.colour);
    }
    Ok(())
}

/// Adds the property tables that a mesh uses.
pub(super) fn add_tables(
    source: &ModelFile,
    document: &Document<'_>,
    mesh: u32,
    tables: &mut BTreeSet<u32>,
) -> Result<()> {
    let primitives = primitives(source, document, mesh, &mut Losses::default())?;
    tables.extend(primitives.iter().filter_map(|primitive| primitive.features?.table));
    Ok(())
}

/// Primitives of a mesh.
pub(super) fn read(
    source: &ModelFile,
    document: &Document<'_>,
    buffers: &Buffers,
    mesh: u32,
    losses: &mut Losses,
) -> Result<Vec<Primitive>> {
    let mut all = Vec::new();
    for Source { primitive, positions, features, order } in primitives(source, document, mesh, losses)? {
        let elements = |index: u32, purpose: Purpose| Elements::of(source, document, buffers, index, purpose);
        let positions = elements(positions, Purpose::Positions)?;
        let indices = primitive.indices.map(|index| elements(index, Purpose::Indices)).transpose()?;
        let colours =
            primitive.attributes.colour.map(|index| elements(index, Purpose::Colours)).transpose()?;
        if let Some(colours) = colours.as_ref().filter(|colours| colours.count != positions.count) {
            let found = format!("{} colours of {} vertices", colours.count, positions.count);
            return Err(source.corrupt(format!("mesh {mesh}"), found, "a colour of each vertex"));
        }
        let features = match features {
            Some(FeatureSource { accessor, table, null }) => {
                let ids = elements(accessor, Purpose::Features)?;
                if ids.count != positions.count {
                    let found = format!("{} feature identifiers of {} vertices", ids.count, positions.count);
                    return Err(source.corrupt(format!("mesh {mesh}"), found, "one of each vertex"));
                }
                Some(Features { ids, table, null })
            }
            None => None,
        };
        let corners = indices.as_ref().unwrap_or(&positions).count;
        if order == Order::Triangles && !corners.is_multiple_of(3) {
            let found = format!("{corners} corners of triangles");
            return Err(source.corrupt(format!("mesh {mesh}"), found, "a multiple of 3"));
        }
        let material = match primitive.material {
            Some(index) => {
                item(source, &document.materials, ("material", index), &format!("mesh {mesh}"))?.colour()
            }
            None => None,
        };
        let factor = material.unwrap_or([1.0; 3]);
        let mut primitive =
            Primitive { positions, indices, colours, features, factor, order, has_faces: true };
        primitive.has_faces = primitive.find_face(source, buffers);
        all.push(primitive);
    }
    Ok(all)
}

impl Primitive {
    /// Number of triangles.
    pub(super) fn count(&self) -> u64 {
        self.order.count(self.indices.as_ref().unwrap_or(&self.positions).count)
    }

    /// Whether a triangle has three distinct corners, or an invalid one.
    fn find_face(&self, source: &ModelFile, buffers: &Buffers) -> bool {
        let positions = self.positions.reader(source, buffers);
        let indices = self.indices.as_ref().map(|indices| indices.reader(source, buffers));
        (0..self.count()).any(|triangle| {
            let corners = self.order.corners(triangle);
            let corners = corners.map(|corner| indices.as_ref().map_or(corner, |it| it.integer(corner)));
            if corners.iter().any(|vertex| *vertex >= positions.len()) {
                return true;
            }
            let [a, b, c]: [[f64; 3]; 3] = corners.map(|vertex| positions.get(vertex));
            a != b && b != c && c != a
        })
    }

    /// Whether triangles have colours, other than white for all.
    pub(super) fn is_coloured(&self) -> bool {
        self.colours.is_some() || self.factor != [1.0; 3]
    }

    /// Visits all triangles by the coordinates of the mesh. Colours are passed if `is_coloured`.
    pub(super) fn visit(
        &self,
        source: &ModelFile,
        buffers: &Buffers,
        is_coloured: bool,
        each: &mut TriangleVisitor<'_>,
    ) -> Result<()> {
        let positions = self.positions.reader(source, buffers);
        let indices = self.indices.as_ref().map(|indices| indices.reader(source, buffers));
        let colours = self.colours.as_ref().map(|colours| colours.reader(source, buffers));
        let features =
            self.features.as_ref().map(|features| (features, features.ids.reader(source, buffers)));
        let plain =
            if self.factor == [1.0; 3] { WHITE } else { self.factor.map(|linear| encode(linear.into())) };
        for triangle in 0..self.count() {
            let mut corners = self.order.corners(triangle);
            if let Some(indices) = &indices {
                corners = corners.map(|corner| indices.integer(corner));
            }
            if let Some(vertex) = corners.iter().find(|vertex| **vertex >= positions.len()) {
                let found = format!("vertex {vertex} of {}", positions.len());
                return Err(source.corrupt(
                    format!("triangle {triangle} of a mesh"),
                    found,
                    "the index of a vertex of the mesh",
                ));
            }
            let colours = is_coloured.then(|| match &colours {
                None => [plain; 3],
                Some(colours) => corners.map(|vertex| {
                    let linear = colours.get::<3>(vertex);
                    std::array::from_fn(|channel| encode(linear[channel] * f64::from(self.factor[channel])))
                }),
            });
            let feature = features.as_ref().and_then(|(features, ids)| features.get(ids, corners[0]));
            each(corners.map(|vertex| positions.get(vertex)), colours, feature)?;
        }
        Ok(())
    }
}

/// Encodes a linear colour channel with the sRGB transfer function, IEC 61966-2-1.
fn encode(linear: f64) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let number = if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
    (number * 255.0).round() as u8
}
