//! Sections of a tree's nodes with their lines or planes, and the boundary of the inside.

use spinney_base::{Error, Progress, Result};
use spinney_brep::ExactPlane;

use super::facet::{Facet, sides};
use super::region::Region;
use super::{Bsp, BspFragment, Division};
use crate::preorder::BinaryNode;

/// Facet in a node's plane; whether its back and its front are inside.
pub(super) struct Boundary {
    pub(super) facet: Facet,
    pub(super) is_inside: [bool; 2],
}

/// Called with a node's division, the nodes on its two sides, and the section of its plane with its
/// cell.
type SectionVisitor<'a> = dyn FnMut(&Division, [usize; 2], Facet) -> Result<()> + 'a;

impl Bsp {
    /// Calls `take` for all dividing nodes, with the sections of their planes with their cells.
    pub(super) fn each_section(&self, take: &mut SectionVisitor<'_>) -> Result<()> {
        let mut pending = vec![(0, Region::space(self.dimension))];
        while let Some((at, region)) = pending.pop() {
            let BinaryNode::Divided { by, second } = &self.nodes[at] else { continue };
            match region.sides(&by.plane) {
                [true, true] => {
                    let ([back, front], section) = region.cut(&by.plane);
                    take(by, [at + 1, *second], section)?;
                    pending.extend([(*second, front), (at + 1, back)]);
                }
                [is_back, _] => pending.push((if is_back { at + 1 } else { *second }, region)),
            }
        }
        Ok(())
    }

    /// Cuts a facet in the plane above two nodes by the cells on both sides, and reports whether
    /// these are inside.
    pub(super) fn on_both_sides(
        &self,
        plane: &ExactPlane,
        [back, front]: [usize; 2],
        facet: Facet,
    ) -> Vec<Boundary> {
        let back = self.in_cells((plane, true), back, facet).into_iter();
        let both = back.flat_map(|(part, inside_back)| {
            let front = self.in_cells((plane, false), front, part).into_iter();
            front.map(move |(facet, inside_front)| Boundary { facet, is_inside: [inside_back, inside_front] })
        });
        both.collect()
    }

    /// Fragments of a facet in the cells below a node, at the back of a plane that contains the
    /// facet or in front of it, and whether these cells are inside.
    fn in_cells(&self, (plane, is_back): (&ExactPlane, bool), at: usize, facet: Facet) -> Vec<(Facet, bool)> {
        let (mut fragments, mut pending) = (Vec::new(), vec![(at, facet)]);
        while let Some((at, facet)) = pending.pop() {
            match &self.nodes[at] {
                BinaryNode::Leaf(is_inside) => fragments.push((facet, *is_inside)),
                BinaryNode::Divided { by, second } => {
                    let signs = facet.signs(&by.plane);
                    match sides(&signs) {
                        [true, true] => {
                            let [back, front] = facet.cut(&by.plane, &signs);
                            pending.extend([(at + 1, back), (*second, front)]);
                        }
                        // (Trees that were read from text may divide by a plane again.)
                        [false, false] => {
                            let is_back = is_back == by.plane.is_turned_as(plane);
                            pending.push((if is_back { at + 1 } else { *second }, facet));
                        }
                        [is_back, _] => pending.push((if is_back { at + 1 } else { *second }, facet)),
                    }
                }
            }
        }
        fragments
    }

    /// Checks that the input fragments are exactly the boundary of the inside, which is at their
    /// back, and walls between bodies that touch.
    pub(super) fn check_boundary(&self, progress: &dyn Progress) -> Result<()> {
        self.each_section(&mut |by, below, section| {
            progress.check()?;
            let mut rest = vec![section];
            let is_turned_as = |fragment: &BspFragment| fragment.facet.plane.is_turned_as(&by.plane);
            let has_walls = by.fragments.iter().any(is_turned_as) && !by.fragments.iter().all(is_turned_as);
            for fragment in &by.fragments {
                let is_turned = !fragment.facet.plane.is_turned_as(&by.plane);
                for part in self.on_both_sides(&by.plane, below, fragment.facet.clone()) {
                    let is_wall = has_walls && part.is_inside == [true; 2];
                    if part.is_inside != [!is_turned, is_turned] && !is_wall {
                        return Err(no_boundary(&part.facet, format!("shape {}", fragment.source)));
                    }
                }
                rest = rest.into_iter().flat_map(|part| part.without(&fragment.facet)).collect();
            }
            for part in rest.into_iter().flat_map(|part| self.on_both_sides(&by.plane, below, part)) {
                if part.is_inside[0] != part.is_inside[1] {
                    return Err(no_boundary(&part.facet, "shapes".into()));
                }
            }
            Ok(())
        })
    }
}

fn no_boundary(facet: &Facet, what: String) -> Error {
    let [x, y, z] = facet.edges[0].start.near;
    let expected = "closed, correctly oriented rings or surfaces that neither cross nor overlap";
    Error::invalid(what, format!("a gap, crossing or overlap near {x}, {y}, {z}"), expected)
}
