//! Reads of exact models: opened, queried, verified, written as meshes, and imported to build
//! another model.

use std::path::Path;

use spinney::brep::{CuttingPlane, FaceBuffer, Faces, MassProperties};
use spinney::export::{MeshFormat, export_exact};
use spinney::raw::brep::ModelNode;
use spinney::raw::brep::surface_intersection::surface_intersection;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::raw::import::mesh;
use spinney::{ExactModel, OpenOptions, Output, Result};

use super::files::in_file;
use super::{seal, trees};

/// A file of an exact model, whose checksums are corrected.
pub fn model_read(bytes: &[u8]) {
    let mut file = bytes.to_vec();
    seal::goblin_end(&mut file);
    seal::goblin(&mut file);
    query_model(file);
}

/// Runs all queries of an exact model's file. If verification finds no defects, no query may fail.
pub fn query_model(file: Vec<u8>) {
    let Ok(model) =
        ExactModel::from_backend(Path::new("(fuzz)"), trees::backend(file.clone()), &OpenOptions::new())
    else {
        return;
    };
    let outcome = fast_queries(&model);
    // (Slower operations, only for some files.)
    if crc32c::crc32c(&file) % 32 < 2 {
        // (Faces that bound no body may not form a surface that can be written or traversed.)
        let _ = topology(&model);
        if crc32c::crc32c(&file).is_multiple_of(64) {
            let _ = surface_intersection(&model, &model, 4 << 20, &());
        }
        exports(&model);
        in_file("model.goblin", &file, |path| {
            let Ok(mut model) = mesh::open(path, 1 << 20) else { return };
            let _ = model.faces(&mut |_| Ok(()));
        });
    }
    if model.verify(64 << 20, &()).unwrap().is_empty() {
        outcome.unwrap();
    }
}

/// Runs all fast queries.
pub fn fast_queries(model: &ExactModel) -> Result<()> {
    let grid = model.grid();
    let _ = (model.nodes().total(), model.sections(), model.segments(), model.metadata());
    assert!(model.depth() <= grid.bits && !model.parts().is_empty());
    let mut done = Ok(());
    let mut note = |result: Result<()>| {
        if done.is_ok() {
            done = result;
        }
    };
    note(model.is_coloured().map(drop));
    note(model.bounds().map(drop));
    note(MassProperties::of(model, &()).map(drop));
    note(model.part_measures(64 << 20, &()).map(drop));
    note(tables(model));
    note(model.root().and_then(|root| nodes(model, &root)));
    // Vertices of faces, points between them, and points that are far off the grid or NaN.
    let max = (1 << grid.bits) - 1;
    let mut points: Vec<[f64; 3]> =
        [[0; 3], [max; 3], [max / 2, 1, max / 3]].map(|point| grid.to_world(point)).into();
    let mut buffer = FaceBuffer::default();
    for number in [0, 1, 7, model.len().saturating_sub(1)] {
        if model.face(number, &mut buffer).is_ok() {
            let face = buffer.face();
            assert!(u64::from(face.part) < model.parts().len() as u64);
            points.extend(face.points.iter().take(2).map(|point| grid.to_world(*point)));
        }
    }
    let [first, last] = [points[0], points[points.len() - 1]];
    points.push([0, 1, 2].map(|axis| first[axis] / 3.0 + last[axis] / 1.5));
    points.extend([[f64::NAN; 3], [f64::INFINITY, 0.0, 0.0], [-1e300; 3]]);
    note(model.locate_all(&points, &mut Vec::new()));
    for pair in points.windows(2) {
        let direction = [0, 1, 2].map(|axis| pair[1][axis] - pair[0][axis]);
        note(model.nearest(pair[0]).map(drop));
        note(model.signed_distance(pair[0]).map(drop));
        note(model.ray(pair[0], direction).map(drop));
        note(model.crossings(pair[0], pair[1]).map(drop));
        // (An unbounded body has no sections, nor do planes with NaN.)
        let distance = (0..3).map(|axis| pair[0][axis] * direction[axis]).sum::<f64>();
        let length = direction.iter().map(|part| part * part).sum::<f64>().sqrt();
        let section = model.section(&CuttingPlane { normal: direction, distance }, &());
        if !model.is_unbounded() && length.is_normal() && distance.is_finite() {
            note(section.map(drop));
        }
        let [min, max] = [f64::min, f64::max].map(|f| [0, 1, 2].map(|axis| f(pair[0][axis], pair[1][axis])));
        // (Boxes with NaN are refused.)
        if min.iter().chain(&max).all(|at| at.is_finite()) {
            note(model.locate_box(min, max).map(drop));
        } else {
            let _ = model.locate_box(min, max);
        }
    }
    for level in [0, model.depth() / 2, grid.bits] {
        let max = ((1u64 << level) - 1) as u32;
        for position in [[0; 3], [max; 3], [max / 2, 0, max]] {
            note(model.cell_coverage(level, position, &()).map(drop));
        }
    }
    done
}

/// Reads the attributes of parts, files and faces, and the model's formula.
fn tables(model: &ExactModel) -> Result<()> {
    model.formula()?;
    model.file_attributes()?;
    let count = model.parts_with_attributes()?;
    let mut with_attributes = 0;
    for (part, name) in (0..).zip(model.parts()) {
        with_attributes += u64::from(model.part_attributes(part)?.is_some());
        let found = model.part_number(name)?;
        assert!(found.is_none_or(|found| &model.parts()[found as usize] == name));
    }
    // (Attributes may refer to parts that do not exist.)
    assert!(with_attributes <= count);
    for column in 0..model.part_columns()?.len() as u32 {
        model.each_part_value(column, &mut |_, _| Ok(()))?;
    }
    for column in 0..model.face_columns()?.len() as u32 {
        model.face_value(column, 0)?;
        model.each_face_value(column, &mut |_, _| Ok(()))?;
    }
    Ok(())
}

/// Traverses a node and all below it.
fn nodes(model: &ExactModel, node: &ModelNode<'_>) -> Result<()> {
    let _ = (node.state(), node.world_box(model.grid()), node.faces().count());
    for child in model.children(node)?.iter().flatten() {
        nodes(model, child)?;
    }
    Ok(())
}

/// Builds a topology, and traverses it.
fn topology(model: &ExactModel) -> Result<()> {
    let options = TopologyOptions { memory: 16 << 20, ..TopologyOptions::default() };
    let topology = Topology::of(model, &options, &())?;
    let _ = (topology.euler(), topology.boundaries().count());
    for shell in 0..topology.shells() {
        let _ = (topology.six_volumes(shell), topology.vertices_of_shell(shell).count());
    }
    for vertex in 0..topology.vertices() {
        let _ = topology.faces_of_vertex(vertex).count();
    }
    Ok(())
}

/// Writes all mesh formats.
fn exports(model: &ExactModel) {
    use MeshFormat::{CityJson, Obj, Off, Ply, Stl};
    for format in [Ply, Obj, Stl, Off, CityJson] {
        in_file("mesh", b"", |path| {
            let output = Output::create(path).unwrap();
            let _ = export_exact(model, format, output, &());
        });
    }
}
