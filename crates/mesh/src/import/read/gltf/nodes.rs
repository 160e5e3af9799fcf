//! Hierarchy of nodes: transforms of the nodes of the scene.

use super::super::model_file::ModelFile;
use super::document::{Document, Node, item};
use spinney_base::Result;

/// Affine transform: three rows of a matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Affine([[f64; 4]; 3]);

/// Rotation from y up, as in glTF, to z up.
const Z_UP: Affine = Affine([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);

impl Affine {
    pub(super) const IDENTITY: Affine =
        Affine([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]);

    /// Scales, then rotates by a quaternion, then translates. Quaternions need not have length 1,
    /// but 0 is none.
    pub(super) fn of(translation: [f64; 3], rotation: [f64; 4], scale: [f64; 3]) -> Option<Affine> {
        let [x, y, z, w] = rotation;
        let mut rows = Affine::IDENTITY.0;
        // (Without a rotation, coordinates are not rounded.)
        if [x, y, z] != [0.0; 3] {
            let square = x * x + y * y + z * z + w * w;
            if !square.is_normal() {
                return None;
            }
            let twice = 2.0 / square;
            rows = [
                [1.0 - twice * (y * y + z * z), twice * (x * y - z * w), twice * (x * z + y * w), 0.0],
                [twice * (x * y + z * w), 1.0 - twice * (x * x + z * z), twice * (y * z - x * w), 0.0],
                [twice * (x * z - y * w), twice * (y * z + x * w), 1.0 - twice * (x * x + y * y), 0.0],
            ];
        } else if w == 0.0 || !w.is_finite() {
            return None;
        }
        for (row, offset) in rows.iter_mut().zip(translation) {
            (0..3).for_each(|axis| row[axis] *= scale[axis]);
            row[3] = offset;
        }
        Some(Affine(rows))
    }

    /// Transform that applies `first`, then this one.
    pub(super) fn after(&self, first: &Affine) -> Affine {
        Affine(self.0.map(|row| {
            std::array::from_fn(|column| {
                let sum: f64 = (0..3).map(|k| row[k] * first.0[k][column]).sum();
                if column == 3 { sum + row[3] } else { sum }
            })
        }))
    }

    #[inline]
    pub(super) fn apply(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        // (The sum has no negative zeros.)
        self.0.map(|[a, b, c, d]| a * x + b * y + c * z + d + 0.0)
    }

    /// Factor of volumes; negative for mirrors.
    pub(super) fn determinant(&self) -> f64 {
        let [[a, b, c, _], [d, e, f, _], [g, h, i, _]] = self.0;
        a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    }
}

/// Transform of a node in its parent.
pub(super) fn local(source: &ModelFile, node: &Node<'_>, number: usize) -> Result<Affine> {
    let place = || format!("node {number}");
    if let Some(matrix) = &node.matrix {
        if [3, 7, 11, 15].map(|at| matrix[at]) != [0.0, 0.0, 0.0, 1.0] {
            let found = "a matrix whose last row is not 0 0 0 1";
            return Err(source.corrupt(place(), found, "an affine transform"));
        }
        // (Stored by columns.)
        let rows = std::array::from_fn(|row| std::array::from_fn(|column| matrix[4 * column + row]));
        return Ok(Affine(rows));
    }
    let translation = node.translation.as_deref().copied().unwrap_or_default();
    let rotation = node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let scale = node.scale.as_deref().copied().unwrap_or([1.0; 3]);
    Affine::of(translation, rotation, scale)
        .ok_or_else(|| source.corrupt(place(), format!("rotation {rotation:?}"), "a quaternion of length 1"))
}

/// Transforms of the nodes of the scene.
pub(super) struct Hierarchy {
    /// Transform of each node's parent to the coordinates of the model, with z up; `None` for nodes
    /// that are not in the scene.
    pub(super) parents: Vec<Option<Affine>>,
}

impl Hierarchy {
    pub(super) fn of(source: &ModelFile, document: &Document<'_>) -> Result<Hierarchy> {
        let nodes = &document.nodes;
        let mut parent_of: Vec<Option<u32>> = vec![None; nodes.len()];
        for (number, node) in (0..).zip(nodes) {
            for child in &node.children {
                item(source, nodes, ("node", *child), &format!("children of node {number}"))?;
                // Without this rule, a small file could have any number of instances.
                if let Some(other) = parent_of[*child as usize].replace(number) {
                    let found = format!("a child of node {other} and of node {number}");
                    return Err(source.corrupt(format!("node {child}"), found, "one parent"));
                }
            }
        }
        // Parents before children.
        let is_root = |number: &u32| parent_of[*number as usize].is_none();
        let mut stack: Vec<u32> = (0..nodes.len() as u32).filter(is_root).collect();
        let mut order = Vec::with_capacity(nodes.len());
        while let Some(number) = stack.pop() {
            order.push(number);
            stack.extend(&nodes[number as usize].children);
        }
        if order.len() < nodes.len() {
            let mut is_reached = vec![false; nodes.len()];
            order.iter().for_each(|number| is_reached[*number as usize] = true);
            let first = is_reached.iter().position(|is_reached| !is_reached).unwrap_or_default();
            let found = "an ancestor of its own, or below one";
            return Err(source.corrupt(format!("node {first}"), found, "a tree of nodes"));
        }
        let mut parents = vec![None; nodes.len()];
        for root in roots(source, document)? {
            item(source, nodes, ("node", root), &"nodes of the scene")?;
            if let Some(parent) = parent_of[root as usize] {
                let found = format!("a root of the scene and a child of node {parent}");
                return Err(source.corrupt(format!("node {root}"), found, "a root without a parent"));
            }
            parents[root as usize] = Some(Z_UP);
        }
        for number in order {
            let node = &nodes[number as usize];
            if let Some(parent) = parents[number as usize].filter(|_| !node.children.is_empty()) {
                let own = Affine::after(&parent, &local(source, node, number as usize)?);
                node.children.iter().for_each(|child| parents[*child as usize] = Some(own));
            }
        }
        Ok(Hierarchy { parents })
    }
}

/// Roots of the default scene, or of the first one; all nodes without a parent if there are no
/// scenes.
fn roots(source: &ModelFile, document: &Document<'_>) -> Result<Vec<u32>> {
    if document.scenes.is_empty() {
        let mut is_child = vec![false; document.nodes.len()];
        let children = document.nodes.iter().flat_map(|node| &node.children);
        children.for_each(|child| is_child[*child as usize] = true);
        return Ok((0..).zip(is_child).filter(|(_, is_child)| !is_child).map(|(number, _)| number).collect());
    }
    let scene = document.scene.unwrap_or(0);
    Ok(item(source, &document.scenes, ("scene", scene), &"default scene")?.nodes.clone())
}
