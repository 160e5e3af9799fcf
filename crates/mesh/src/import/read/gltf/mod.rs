//! glTF 2.0: meshes under a hierarchy of nodes, as JSON or binary (.gltf, .glb).
//!
//! The JSON document is parsed as a whole; vertices and indices stay in the mapped file, or in
//! temporary files if they are embedded as base64 or compressed. A mesh under several nodes is
//! stored once: its triangles are transformed whenever faces are read.

mod accessors;
mod buffers;
mod compressed;
mod container;
mod document;
mod feature_parts;
mod losses;
mod meshes;
mod nodes;
mod property;
mod property_tables;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use self::accessors::{Elements, Purpose};
use self::buffers::Buffers;
use self::container::Container;
pub(super) use self::container::{is_binary, is_text};
use self::document::{Document, InstanceAttributes, Node, item, string};
use self::feature_parts::{FeatureParts, MeshUse};
use self::losses::Losses;
use self::meshes::Primitive;
use self::nodes::{Affine, Hierarchy, local};
use self::property_tables::PropertyTables;
use super::corners::Corners;
use super::model_file::ModelFile;
use super::parts::PartNames;
use super::vertices::VertexBounds;
use super::{MeshFace, Model, ModelInfo};
use spinney_base::Result;
use spinney_base::io::FileAccess;
use spinney_brep::Attributes;

struct Gltf {
    source: ModelFile,
    info: ModelInfo,
    buffers: Buffers,
    /// Primitives of the meshes in the scene, by mesh number.
    meshes: BTreeMap<u32, Vec<Primitive>>,
    mesh_nodes: Vec<MeshNode>,
    features: FeatureParts,
    losses: Losses,
    degenerate: u64,
}

/// Callback for each placed mesh: its primitives, owner, and transforms, which apply in order.
type MeshVisitor<'a> = dyn FnMut(&[Primitive], Owner, [&Affine; 2]) -> Result<()> + 'a;

/// Part of the faces of a node that have no feature of their own.
#[derive(Clone, Copy)]
struct Owner {
    part: u32,
    /// The node, if its features are parts.
    node: Option<MeshUse>,
}

/// Mesh of a node, once or as several instances.
struct MeshNode {
    mesh: u32,
    /// Owner of the first instance. The parts of the following ones have the next numbers, unless
    /// the file has a single part.
    owner: Owner,
    /// Transform of the node's parent to the coordinates of the model. (It is applied separately,
    /// so that vertices that siblings share remain equal: products of transforms are rounded.)
    parent: Affine,
    local: Affine,
    instances: Option<Instances>,
}

/// Transforms of the instances of a node (EXT_mesh_gpu_instancing).
struct Instances {
    count: u64,
    translations: Option<Elements>,
    rotations: Option<Elements>,
    scales: Option<Elements>,
}

impl Instances {
    fn of(
        source: &ModelFile,
        document: &Document<'_>,
        buffers: &Buffers,
        (number, attributes): (usize, InstanceAttributes),
    ) -> Result<Instances> {
        let elements = |index: Option<u32>, purpose: Purpose| {
            index.map(|index| Elements::of(source, document, buffers, index, purpose)).transpose()
        };
        let translations = elements(attributes.translation, Purpose::Vectors)?;
        let rotations = elements(attributes.rotation, Purpose::Rotations)?;
        let scales = elements(attributes.scale, Purpose::Vectors)?;
        let all = [&translations, &rotations, &scales];
        let counts: Vec<u64> = all.into_iter().flatten().map(|elements| elements.count).collect();
        let place = || format!("node {number}, EXT_mesh_gpu_instancing");
        let Some(&count) = counts.first() else {
            return Err(source.corrupt(place(), "no transforms", "TRANSLATION, ROTATION or SCALE"));
        };
        if let Some(other) = counts.iter().find(|other| **other != count) {
            return Err(source.corrupt(place(), format!("{count} and {other} instances"), "equal counts"));
        }
        Ok(Instances { count, translations, rotations, scales })
    }

    fn transform(&self, source: &ModelFile, buffers: &Buffers, number: u64) -> Result<Affine> {
        let read = |elements: &Option<Elements>, default: [f64; 3]| {
            elements.as_ref().map_or(default, |elements| elements.reader(source, buffers).get(number))
        };
        let rotation = self.rotations.as_ref().map(|elements| elements.reader(source, buffers).get(number));
        let rotation = rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        Affine::of(read(&self.translations, [0.0; 3]), rotation, read(&self.scales, [1.0; 3])).ok_or_else(
            || {
                let found = format!("rotation {rotation:?}");
                source.corrupt(format!("instance {number} of a node"), found, "a quaternion of length 1")
            },
        )
    }
}

/// Accessors of the instances of a node.
fn instancing(node: &Node<'_>) -> Option<InstanceAttributes> {
    Some(node.extensions.as_ref()?.instancing.as_ref()?.attributes)
}

pub(super) fn open(source: ModelFile, memory: u64, access: &FileAccess) -> Result<Box<dyn Model>> {
    let Container { json, binary } = Container::of(&source)?;
    let document = document::parse(&source, &source.bytes()[json], memory)?;
    losses::check_required(&source, &document)?;
    let hierarchy = Hierarchy::of(&source, &document)?;
    let placed: Vec<usize> = (0..document.nodes.len())
        .filter(|number| hierarchy.parents[*number].is_some() && document.nodes[*number].mesh.is_some())
        .collect();
    let meshes: BTreeSet<u32> = placed.iter().filter_map(|number| document.nodes[*number].mesh).collect();
    let tables = document.extensions.as_ref().and_then(|extensions| extensions.metadata);
    let tables = PropertyTables::of(&source, tables, memory)?;
    let buffers = load(&source, &document, binary, (&placed, &meshes, &tables), access, memory)?;

    let mut losses = Losses::of(&document);
    let read = |mesh: &u32| Ok((*mesh, meshes::read(&source, &document, &buffers, *mesh, &mut losses)?));
    let meshes: BTreeMap<u32, Vec<Primitive>> = meshes.iter().map(read).collect::<Result<_>>()?;
    let (mut names, mut attributes) = (PartNames::new(memory), Attributes::within(memory.max(1 << 20)));
    let (mut features, mut mesh_nodes, mut copies) = (FeatureParts::default(), Vec::new(), BTreeMap::new());
    for &number in &placed {
        let node = &document.nodes[number];
        let (Some(parent), Some(mesh)) = (hierarchy.parents[number], node.mesh) else { continue };
        let instances = instancing(node)
            .map(|attributes| Instances::of(&source, &document, &buffers, (number, attributes)))
            .transpose()?;
        let local = local(&source, node, number)?;
        let primitives = meshes.get(&mesh).map_or(&[][..], Vec::as_slice);
        let mut owner = Owner { part: 0, node: None };
        let mut has_part = true;
        if primitives.iter().any(|primitive| primitive.features.is_some()) {
            match instances {
                // (Instances are the objects.)
                Some(_) => losses.features += 1,
                None => {
                    let copy = copies.entry(mesh).or_insert(0);
                    let mesh_use = MeshUse { number: number as u32, copy: *copy };
                    *copy += 1;
                    has_part = features.add(&source, &buffers, (mesh_use, primitives), memory)?;
                    owner.node = Some(mesh_use);
                }
            }
        }
        mesh_nodes.push((number, has_part, MeshNode { mesh, owner, parent, local, instances }));
    }
    let name = |number: usize| -> Result<String> {
        let node = &document.nodes[number];
        let of_mesh =
            node.mesh.map(|mesh| item(&source, &document.meshes, ("mesh", mesh), &"nodes")).transpose()?;
        let given = [node.name, of_mesh.and_then(|mesh| mesh.name)];
        let given = given.into_iter().flatten().filter_map(string).find(|name| !name.is_empty());
        Ok(given.map_or_else(|| format!("node {number}"), String::from))
    };
    let file = (&source, &buffers);
    losses.columns += features.describe(file, &tables, &name, (&mut names, &mut attributes))?;
    // Our own exports have a node per block of cells: these are fragments of one surface.
    let is_one = document.is_own();
    for (number, has_part, node) in &mut mesh_nodes {
        if !*has_part {
            continue;
        }
        node.owner.part = names.len();
        if is_one && names.len() == 0 {
            continue;
        }
        let name = name(*number)?;
        match &node.instances {
            None => names.push(&source, name)?,
            Some(Instances { count, .. }) => {
                (1..=*count).try_for_each(|instance| names.push(&source, format!("{name} #{instance}")))?;
            }
        }
    }
    let mesh_nodes: Vec<MeshNode> = mesh_nodes.into_iter().map(|(_, _, node)| node).collect();
    let is_coloured = meshes.values().flatten().any(Primitive::is_coloured);
    let kind = if binary_of(&source) { "glTF 2.0, binary" } else { "glTF 2.0" };
    let info = ModelInfo {
        path: source.path().to_path_buf(),
        format: kind.into(),
        faces: None,
        bounds: [[0.0; 3]; 2],
        crs: None,
        unit: Some("m".into()),
        step: None,
        parts: names.names(),
        is_grouped: false,
        is_z_up: true,
        attributes,
        is_coloured,
        bytes: source.bytes().len() as u64,
    };
    drop((document, tables));
    let mut model = Gltf { source, info, buffers, meshes, mesh_nodes, features, losses, degenerate: 0 };
    model.measure()?;
    Ok(Box::new(model))
}

fn binary_of(source: &ModelFile) -> bool {
    is_binary(source.bytes())
}

/// Loads the bytes of the nodes that are placed, and of their meshes.
fn load(
    source: &ModelFile,
    document: &Document<'_>,
    binary: Option<std::ops::Range<usize>>,
    (placed, meshes, tables): (&[usize], &BTreeSet<u32>, &PropertyTables),
    access: &FileAccess,
    memory: u64,
) -> Result<Buffers> {
    let (mut accessors, mut views) = (BTreeSet::new(), BTreeSet::new());
    meshes.iter().try_for_each(|mesh| meshes::add_accessors(source, document, *mesh, &mut accessors))?;
    for InstanceAttributes { translation, rotation, scale } in
        placed.iter().filter_map(|number| instancing(&document.nodes[*number]))
    {
        accessors.extend([translation, rotation, scale].into_iter().flatten());
    }
    let mut used = BTreeSet::new();
    meshes.iter().try_for_each(|mesh| meshes::add_tables(source, document, *mesh, &mut used))?;
    used.iter().try_for_each(|table| tables.add_views(source, *table, &mut views))?;
    accessors.iter().try_for_each(|index| accessors::add_views(source, document, *index, &mut views))?;
    Buffers::load(source, document, binary, &views, access, memory)
}

/// Paths of all files that buffers are in, whether they exist or not.
pub(super) fn siblings(source: &ModelFile) -> Vec<PathBuf> {
    let json = Container::of(source).map(|container| container.json);
    let json = json.map(|range| &source.bytes()[range]);
    let document = json.and_then(|json| document::parse(source, json, u64::MAX));
    document.map(|document| buffers::siblings(source, &document.buffers)).unwrap_or_default()
}

impl Gltf {
    /// Visits all placed meshes that are not flat; returns the number of those that are.
    fn visit(&self, each: &mut MeshVisitor<'_>) -> Result<u64> {
        let mut flat = 0;
        for MeshNode { mesh, owner, parent, local, instances } in &self.mesh_nodes {
            let primitives = self.meshes.get(mesh).map_or(&[][..], Vec::as_slice);
            let Some(instances) = instances else {
                if local.determinant() * parent.determinant() == 0.0 {
                    flat += 1;
                } else {
                    each(primitives, *owner, [local, parent])?;
                }
                continue;
            };
            let parent = parent.after(local);
            for number in 0..instances.count {
                let local = instances.transform(&self.source, &self.buffers, number)?;
                let part = if self.info.parts.len() > 1 { owner.part + number as u32 } else { owner.part };
                if local.determinant() * parent.determinant() == 0.0 {
                    flat += 1;
                } else {
                    each(primitives, Owner { part, node: None }, [&local, &parent])?;
                }
            }
        }
        Ok(flat)
    }

    /// Checks all vertices, and determines their bounds and the number of faces.
    fn measure(&mut self) -> Result<()> {
        let (mut bounds, mut faces, mut read) = (VertexBounds::new(), 0u64, 0);
        let flat = self.visit(&mut |primitives, _, transforms| {
            for primitive in primitives {
                faces = faces.saturating_add(primitive.count());
                let positions = primitive.positions.reader(&self.source, &self.buffers);
                for number in 0..positions.len() {
                    self.passed(read);
                    read += 1;
                    let point = placed(positions.get(number), transforms);
                    if !point.iter().all(|coordinate| coordinate.is_finite()) {
                        let place = format!("vertex {number} of a mesh");
                        return Err(self.source.corrupt(place, format!("{point:?}"), "finite coordinates"));
                    }
                    bounds.add(point);
                }
            }
            Ok(())
        })?;
        self.losses.flat = flat;
        // (Progress sums these numbers.)
        self.info.faces = Some(faces).filter(|faces| *faces < 1 << 48);
        self.info.bounds = bounds.get().ok_or_else(|| self.source.no_vertices())?;
        Ok(())
    }

    fn passed(&self, number: u64) {
        self.source.passed(number);
        self.buffers.passed(number);
    }
}

/// Point of a mesh in the coordinates of the model.
#[inline]
fn placed(point: [f64; 3], [local, parent]: [&Affine; 2]) -> [f64; 3] {
    parent.apply(local.apply(point))
}

impl Model for Gltf {
    fn info(&self) -> &ModelInfo {
        &self.info
    }

    fn faces(&mut self, each: &mut dyn FnMut(&MeshFace<'_>) -> Result<()>) -> Result<()> {
        let (mut corners, mut read) = (Corners::default(), 0);
        self.visit(&mut |primitives, owner, transforms| {
            let [local, parent] = transforms.map(Affine::determinant);
            // (Mirrors reverse the direction of triangles.)
            let order = if local * parent < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
            for primitive in primitives {
                if !primitive.has_faces {
                    corners.degenerate += primitive.count();
                    continue;
                }
                let part_of = |feature: Option<u64>| {
                    self.features.part(primitive.features.as_ref()?, owner.node?, feature?)
                };
                let mut last = (None, owner.part);
                primitive.visit(
                    &self.source,
                    &self.buffers,
                    self.info.is_coloured,
                    &mut |points, colours, feature| {
                        if last.0 != feature {
                            last = (feature, part_of(feature).unwrap_or(owner.part));
                        }
                        self.passed(read);
                        read += 1;
                        corners.clear();
                        for corner in order {
                            corners.push(placed(points[corner], transforms));
                            if let Some(colours) = colours {
                                corners.push_colour(colours[corner]);
                            }
                        }
                        corners.hand_out(last.1, each)
                    },
                )?;
            }
            Ok(())
        })?;
        self.degenerate = corners.degenerate;
        Ok(())
    }

    fn degenerate(&self) -> u64 {
        self.degenerate
    }

    fn remarks(&self) -> Vec<String> {
        self.losses.remark().into_iter().collect()
    }
}
