//! Winged edges of an exact model, and the relations of its vertices, faces and shells.

use std::fmt::Write as _;

use anyhow::Result;
use spinney::brep::Faces;
use spinney::raw::brep::topology::{Topology, TopologyOptions};
use spinney::{ExactModel, Progress};

use super::super::args::DEFAULT_MEMORY;

/// Returns a line for each vertex, edge, face and shell of a model.
pub(super) fn text(model: &ExactModel, limit: u64, progress: &dyn Progress) -> Result<String> {
    super::check_count(model.path(), model.len(), "faces", limit)?;
    let options = TopologyOptions { memory: DEFAULT_MEMORY, path: model.path().to_path_buf() };
    let topology = Topology::of(model, &options, progress)?;
    let mut text = String::new();
    text.push_str("# vertex, coordinates, shell; edges; faces; neighbours\n");
    for vertex in 0..topology.vertices() {
        let at = model.grid().to_world(topology.point(vertex)).map(|at| at.to_string()).join(",");
        write!(text, "v{vertex}\t{at}\ts{}", topology.shell_of_vertex(vertex))?;
        push_list(&mut text, 'e', topology.edges_of_vertex(vertex));
        push_list(&mut text, 'f', topology.faces_of_vertex(vertex));
        push_list(&mut text, 'v', topology.neighbours_of_vertex(vertex));
        text.push('\n');
    }
    // (An edge of an open surface has one face.)
    text.push_str("# edge, vertices; faces at the left and the right; edges before and after it there\n");
    for edge in 0..topology.edges() {
        progress.check()?;
        write!(text, "e{edge}")?;
        push_list(&mut text, 'v', topology.vertices_of_edge(edge));
        let (left, right) = topology.faces_of_edge(edge);
        push_list(&mut text, 'f', [Some(left), right].into_iter().flatten());
        let (first, second) = topology.half_edges_of_edge(edge);
        for half_edge in [Some(first), second].into_iter().flatten() {
            let around = [topology.previous(half_edge), topology.next(half_edge)];
            push_list(&mut text, 'e', around.map(|half_edge| topology.edge(half_edge)));
        }
        text.push('\n');
    }
    text.push_str("# face; vertices; edges; neighbours\n");
    for face in 0..topology.faces() {
        write!(text, "f{face}")?;
        push_list(&mut text, 'v', topology.vertices_of_face(face));
        push_list(&mut text, 'e', topology.edges_of_face(face));
        push_list(&mut text, 'f', topology.neighbours_of_face(face));
        text.push('\n');
    }
    text.push_str("# shell, volume; numbers of faces, edges, half-edges and vertices\n");
    for shell in 0..topology.shells() {
        let volume = topology.six_volumes(shell) as f64 / 6.0 * model.grid().width().powi(3);
        let counts = [
            topology.faces_of_shell(shell).len(),
            topology.edges_of_shell(shell).count(),
            topology.half_edges_of_shell(shell).count(),
            topology.vertices_of_shell(shell).count(),
        ];
        let [faces, edges, half_edges, vertices] = counts;
        writeln!(text, "s{shell}\t{volume}\t{faces}\t{edges}\t{half_edges}\t{vertices}")?;
    }
    Ok(text)
}

/// Appends a tab, and names of a letter and a number each.
fn push_list(text: &mut String, letter: char, numbers: impl IntoIterator<Item = u32>) {
    let names: Vec<String> = numbers.into_iter().map(|number| format!("{letter}{number}")).collect();
    text.push('\t');
    text.push_str(&names.join(" "));
}
