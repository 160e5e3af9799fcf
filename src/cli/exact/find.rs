//! `spinney find` of an exact model: leaves of its octree.

use anyhow::Result;
use serde_json::json;
use spinney::brep::Faces;
use spinney::raw::brep::{ModelNode, ModelNodeState, NodeKind};
use spinney::{Code, Dimension, ExactModel};

use super::super::report::Found;

/// Kinds of leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum LeafKind {
    /// Outside of the body
    Void,
    /// Inside
    Full,
    /// Cut by faces of one plane
    Face,
    /// Cut by faces whose planes have a common line
    Edge,
    /// Cut by faces whose planes have a common point
    Vertex,
    /// Cut by faces whose planes have nothing in common
    Boolean,
}

impl LeafKind {
    /// Returns the kind of a leaf; `None` for an inner node.
    fn of(state: ModelNodeState) -> Option<LeafKind> {
        Some(match state {
            ModelNodeState::Void => LeafKind::Void,
            ModelNodeState::Full => LeafKind::Full,
            ModelNodeState::Inner => return None,
            ModelNodeState::Leaf { kind: NodeKind::Face, .. } => LeafKind::Face,
            ModelNodeState::Leaf { kind: NodeKind::Edge, .. } => LeafKind::Edge,
            ModelNodeState::Leaf { kind: NodeKind::Vertex, .. } => LeafKind::Vertex,
            ModelNodeState::Leaf { kind: NodeKind::Boolean, .. } => LeafKind::Boolean,
        })
    }

    fn name(self) -> &'static str {
        match self {
            LeafKind::Void => "void",
            LeafKind::Full => "full",
            LeafKind::Face => "face",
            LeafKind::Edge => "edge",
            LeafKind::Vertex => "vertex",
            LeafKind::Boolean => "boolean",
        }
    }
}

/// Lists the leaves of some kinds, in Z order.
pub(crate) fn find(model: &ExactModel, kinds: &[LeafKind], is_json: bool, found: &mut Found) -> Result<()> {
    visit(model, &model.root()?, &mut |node| match LeafKind::of(node.state()) {
        Some(kind) if kinds.contains(&kind) => {
            // (The octree of a model is never deeper than locational codes allow.)
            let code = Code::from_cell(Dimension::Oct, node.level(), node.position());
            let code = code.map_or(String::new(), |code| code.to_string());
            found.take(node.level(), &code, &|| line(model, node, &code, kind, is_json))
        }
        _ => Ok(true),
    })?;
    Ok(())
}

/// Visits a node and its descendants in Z order, until `each` returns `false`. Returns whether to
/// continue.
fn visit(
    model: &ExactModel,
    node: &ModelNode<'_>,
    each: &mut dyn FnMut(&ModelNode<'_>) -> spinney::Result<bool>,
) -> spinney::Result<bool> {
    if !each(node)? {
        return Ok(false);
    }
    for child in model.children(node)?.iter().flatten() {
        if !visit(model, child, each)? {
            return Ok(false);
        }
    }
    Ok(true)
}

/// Formats a leaf as a line of text or a JSON object.
fn line(model: &ExactModel, node: &ModelNode<'_>, code: &str, kind: LeafKind, is_json: bool) -> String {
    let (level, position, kind, faces) = (node.level(), node.position(), kind.name(), node.faces().count());
    let world = node.world_box(model.grid());
    if is_json {
        let leaf = json!({
            "code": code,
            "level": level,
            "kind": kind,
            "position": position,
            "world": world,
            "faces": faces,
        });
        return leaf.to_string();
    }
    let [x, y, z] = position;
    let world = world.as_flattened().iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    format!("{code} {level} {kind} {x},{y},{z} {world} {faces}")
}
