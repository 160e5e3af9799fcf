//! Objects of a result: the one place that decides to which object each face belongs.
//!
//! An object is a part whose faces are closed by themselves. Other parts, such as groups of faces
//! with one material, are names of faces: their faces keep them.
//!
//! A face belongs to the object that it bounds, at its back. Which object that is depends on where
//! the result can be:
//!
//! | the result is inside of            | operations        | a point belongs to                  |
//! | ---------------------------------- | ----------------- | ----------------------------------- |
//! | the first operand                  | `and`, `a-b`, `a` | the first operand's object there    |
//! | the second operand                 | `b-a`, `b`        | the second operand's object there   |
//! | no operand in particular           | `or`, `xor`       | an object of any operand there      |
//!
//! In the first two cases the operand is the *owner*: each of its objects is cut by itself, and the
//! other operands' objects are only tools. In the last case, objects of different operands become
//! one object, with the name and the attributes of the first, if they overlap or have a wall in
//! common, since the result has no faces between them. Walls between touching objects of one
//! operand stay: both of their faces.
//!
//! An unbounded result has the objects of its complement, reversed: they are its cavities. So
//! `nand`, `b|!a`, `not` and `a|!b`, `not-b`, `nor` and `xnor` follow `and`, `a-b`, `a`, `b-a`,
//! `b`, `or` and `xor`. Likewise, the objects of an unbounded operand are its cavities.

use std::collections::HashMap;
use std::sync::Mutex;

use super::common_grid::CommonGrid;
use super::table::{Fate, OperationTable};
use super::winding::{part_windings, winding};
use crate::arrangement::{ExactPlane, FaceAtSample, FaceOwner, SamplePoint};
use crate::exact::union_find::UnionFind;
use crate::face_set::FaceSet;
use crate::query::half_of;
use crate::{ExactModel, Faces, ModelNode, ModelNodeState};
use spinney_base::{Progress, Result};

/// Maximum number of operands for which all combinations are tried.
const MAX_TRIED: usize = 10;
/// Maximum number of nodes whose objects are remembered.
const MAX_KNOWN: usize = 1 << 16;

/// Operand, level and position of a node.
type NodeKey = (usize, u8, [u32; 3]);

/// The objects of the operands and of the result. Parts are numbered over all operands, in order.
pub(super) struct Owners<'a> {
    models: &'a [&'a ExactModel],
    common_grid: &'a CommonGrid,
    table: OperationTable,
    operands: Vec<OperandObjects>,
    /// Whether the result includes infinity, so that its objects are cavities.
    is_turned: bool,
    /// The operand that the result is inside of, if there is one.
    owner: Option<usize>,
    /// Whether points in any objects have an object in the result.
    is_union: bool,
    /// Objects that are one in the result.
    united: Mutex<UnionFind>,
    /// Objects at uniform nodes, by operand, level and position.
    known: Mutex<HashMap<NodeKey, Option<u32>>>,
}

/// The objects of an operand.
struct OperandObjects {
    /// Number of the first part, and the number of parts.
    first: u32,
    count: u32,
    /// Parts that are closed by themselves, counted from 0.
    closed: FaceSet,
    /// The first of them.
    any: Option<u32>,
    /// Whether all faces belong to closed parts, and whether these are only one.
    are_all: bool,
    is_one: bool,
    /// Whether the operand includes infinity, so that its objects are cavities.
    is_turned: bool,
}

impl OperandObjects {
    fn of(model: &ExactModel, first: u32, memory: u64, progress: &dyn Progress) -> Result<OperandObjects> {
        let count = model.parts().len() as u32;
        let (mut closed, mut any, mut objects, mut open) = (FaceSet::new(count.into()), None, 0u64, 0u64);
        let mut note = |part: u32, is_closed: bool| {
            if is_closed {
                closed.set(part.into(), true);
                any.get_or_insert(part);
                objects += 1;
            } else {
                open += 1;
            }
        };
        let mut has_sums = count == 1;
        if has_sums {
            note(0, true);
        } else {
            has_sums = model.each_part_sums(&mut |part, sums| {
                note(part, sums.is_closed);
                Ok(())
            })?;
        }
        if !has_sums {
            model.part_measures(memory, progress)?.iter().for_each(|part| note(part.part, part.is_closed));
        }
        let is_turned = model.far_winding() > 0;
        let (are_all, is_one) = (open == 0, open == 0 && objects == 1);
        Ok(OperandObjects { first, count, closed, any, are_all, is_one, is_turned })
    }

    /// Whether a part, counted over all operands, is an object of this one.
    fn is_object(&self, part: u32) -> bool {
        part >= self.first && self.closed.has((part - self.first).into())
    }
}

/// New numbers of the parts of all operands in the result.
pub(super) struct PartNumbers {
    /// By old number; parts of tools have the number of an object.
    numbers: Vec<u32>,
    /// Parts that the result does not have: those of tools, and those united with others.
    pub(super) dropped: FaceSet,
}

impl PartNumbers {
    /// Keeps all parts.
    pub(super) fn unchanged(models: &[&ExactModel]) -> PartNumbers {
        let count = models.iter().map(|model| model.parts().len() as u32).sum();
        PartNumbers { numbers: (0..count).collect(), dropped: FaceSet::new(count.into()) }
    }

    pub(super) fn of(&self, part: u32) -> u32 {
        self.numbers.get(part as usize).copied().unwrap_or(part)
    }
}

impl<'a> Owners<'a> {
    pub(super) fn of(
        models: &'a [&'a ExactModel],
        common_grid: &'a CommonGrid,
        table: OperationTable,
        memory: u64,
        progress: &dyn Progress,
    ) -> Result<Owners<'a>> {
        let (mut operands, mut first) = (Vec::new(), 0);
        for model in models {
            operands.push(OperandObjects::of(model, first, memory, progress)?);
            first += model.parts().len() as u32;
        }
        let far: Vec<i32> = models.iter().map(|model| model.far_winding()).collect();
        let mut owners = Owners {
            models,
            common_grid,
            table,
            operands,
            is_turned: table.is_inside(&far),
            owner: None,
            is_union: false,
            united: Mutex::new(UnionFind::new(first as usize)),
            known: Mutex::default(),
        };
        owners.owner = owners.find_owner();
        let first = |count: usize| (0..models.len()).map(|k| k < count).collect::<Vec<_>>();
        let are_bounded = owners.operands.iter().all(|own| !own.is_turned);
        owners.is_union = are_bounded && owners.has_object(&first(1)) && owners.has_object(&first(2));
        Ok(owners)
    }

    /// Returns the first operand that contains all points that have an object.
    fn find_owner(&self) -> Option<usize> {
        let count = self.operands.len();
        if count > MAX_TRIED {
            // (Unions and symmetric differences of fewer operands have no owner, and intersections
            // and differences the first one. An unbounded operand exchanges the two.)
            let is_inside =
                |index: usize| self.has_object(&(0..count).map(|k| k == index).collect::<Vec<_>>());
            return (!is_inside(1) && !is_inside(count - 1)).then_some(0);
        }
        let sets =
            || (0..1usize << count).map(|set| (0..count).map(|k| set >> k & 1 == 1).collect::<Vec<_>>());
        (0..count).find(|k| sets().filter(|set| self.has_object(set)).all(|set| set[*k]))
    }

    /// Whether points in the objects of these operands have an object in the result.
    fn has_object(&self, members: &[bool]) -> bool {
        let is_in = |k: usize| members[k] != self.operands[k].is_turned;
        self.table.includes(is_in) != self.is_turned
    }

    /// Unites parts, which are objects.
    fn unite(&self, parts: impl Iterator<Item = u32>) {
        let mut united = self.united.lock().expect("no thread panics while it holds this lock");
        parts.reduce(|first, other| united.join(first, other));
    }

    /// Returns the number of operand `k`'s object at a point that is on none of its faces.
    fn object_at(&self, k: usize, sample: &SamplePoint<'_>) -> Result<Option<u32>> {
        let own = &self.operands[k];
        let Some(any) = own.any else { return Ok(None) };
        if own.is_one {
            return Ok(Some(own.first + any));
        }
        let windings = part_windings(self.models[k], k, self.common_grid, sample)?;
        let sign = if own.is_turned { -1 } else { 1 };
        let around = windings.into_iter().filter(|(part, winding)| {
            sign * winding > 0 && *part < own.count && own.closed.has((*part).into())
        });
        Ok(around.map(|(part, _)| own.first + part).min())
    }

    /// Returns the number of operand `k`'s object at a point of the common grid that is far from
    /// its faces. Nodes without faces have one object, which is remembered.
    fn object_at_point(&self, k: usize, at: [i32; 3]) -> Result<Option<u32>> {
        if self.operands[k].is_one || self.operands[k].any.is_none() {
            return Ok(self.operands[k].any.map(|any| self.operands[k].first + any));
        }
        let node = self.node_at(k, at)?;
        let key = node.as_ref().filter(|node| node.winding().is_some());
        let key = key.map(|node| (k, node.level(), node.position()));
        let lock = || self.known.lock().expect("no thread panics while it holds this lock");
        if let Some(found) = key.and_then(|key| lock().get(&key).copied()) {
            return Ok(found);
        }
        let plane = ExactPlane::through(at, [0, 0, 1]);
        let found = self.object_at(k, &SamplePoint::of_triangle(&plane, &[at; 3]))?;
        if let Some(key) = key {
            let mut known = lock();
            if known.len() == MAX_KNOWN {
                known.clear();
            }
            known.insert(key, found);
        }
        Ok(found)
    }

    /// Returns the node of operand `k` without children that contains a point of the common grid.
    fn node_at(&self, k: usize, at: [i32; 3]) -> Result<Option<ModelNode<'a>>> {
        let at = at.map(|at| 2 * i64::from(at));
        let mut node = self.models[k].root()?;
        let mut cell = self.common_grid.half_units(k, &node);
        if (0..3).any(|axis| at[axis] < cell[0][axis] || at[axis] > cell[1][axis]) {
            return Ok(None);
        }
        while node.state() == ModelNodeState::Inner {
            let is_upper = |axis: usize| 2 * at[axis] >= cell[0][axis] + cell[1][axis];
            let child = (0..3).map(|axis| usize::from(is_upper(axis)) << axis).sum();
            cell = half_of(&cell, child);
            node = self.models[k].child(&node, child)?;
        }
        Ok(Some(node))
    }

    /// Whether a point of the common grid, far from the faces of operand `k`, is in its objects.
    fn is_in_objects(&self, k: usize, at: [i32; 3]) -> Result<bool> {
        let known = self.common_grid.winding_at(self.models, k, at.map(|at| 2 * i64::from(at)))?;
        let found = match known {
            Some(found) => found,
            None => {
                let plane = ExactPlane::through(at, [0, 0, 1]);
                let sample = SamplePoint::of_triangle(&plane, &[at; 3]);
                winding(self.models[k], k, self.common_grid, &sample)?
            }
        };
        Ok((found > 0) != self.operands[k].is_turned)
    }

    /// Whether the points at the object side of a settled face of operand `own` are in its object.
    fn keeps_side(&self, own: usize, fate: Fate) -> bool {
        ((fate == Fate::Reverse) == self.is_turned) != self.operands[own].is_turned
    }

    /// Returns in which operands' objects the points at the object side of a settled face of
    /// operand `own` are. `at` is a point of the face, far from the other operands' faces.
    fn members(&self, own: usize, fate: Fate, at: [i32; 3]) -> Result<Vec<bool>> {
        let mut members = vec![false; self.operands.len()];
        members[own] = self.keeps_side(own, fate);
        for k in (0..members.len()).filter(|k| *k != own) {
            members[k] = match self.only_fate(own, fate) {
                Some(is_in) => is_in != self.operands[k].is_turned,
                None => self.is_in_objects(k, at)?,
            };
        }
        Ok(members)
    }

    /// Whether a face of operand `own` with a fate is inside of the other one, if there are two and
    /// the fate determines it.
    fn only_fate(&self, own: usize, fate: Fate) -> Option<bool> {
        let has_fate = |winding: i32| self.table.fate(own, &[winding; 2]) == fate;
        match (self.operands.len() == 2).then(|| [has_fate(0), has_fate(1)])? {
            [true, false] => Some(false),
            [false, true] => Some(true),
            _ => None,
        }
    }

    /// Whether all settled faces of an operand keep their parts.
    pub(super) fn keeps_parts(&self, own: usize, fate: Fate) -> bool {
        match self.owner {
            Some(owner) => owner == own,
            None => self.keeps_side(own, fate),
        }
    }

    /// Returns the part of a settled face of operand `own`, from its own part; `at` is a point of
    /// it.
    pub(super) fn of_settled(&self, own: usize, part: u32, fate: Fate, at: [i32; 3]) -> Result<u32> {
        if self.keeps_parts(own, fate) {
            return Ok(part);
        }
        let found = match self.owner {
            Some(owner) => self.object_at_point(owner, at)?,
            None => match self.members(own, fate, at)? {
                members if members[own] => None,
                members => match members.iter().position(|is_in| *is_in) {
                    Some(other) => self.object_at_point(other, at)?,
                    None => None,
                },
            },
        };
        Ok(found.unwrap_or(part))
    }

    /// Whether no settled faces with a fate have several objects on a side.
    pub(super) fn is_plain(&self, fate: Fate) -> bool {
        // (In unions, and in operations on two operands, only dropped faces have.)
        self.owner.is_some() || (fate != Fate::Drop && (self.operands.len() == 2 || self.is_union))
    }

    /// Unites the objects that are on both sides of a settled face, and those that overlap there.
    /// Must be called for all settled faces before [`Owners::numbers`].
    pub(super) fn note_settled(&self, own: usize, part: u32, fate: Fate, at: [i32; 3]) -> Result<()> {
        if self.is_plain(fate) || !self.operands[own].is_object(part) {
            return Ok(());
        }
        let mut members = self.members(own, fate, at)?;
        members[own] = false;
        let is_inside_without = self.has_object(&members);
        members[own] = true;
        let is_inside_with = self.has_object(&members);
        // (Else the face bounds nothing, or what it bounds is not in its object.)
        if !is_inside_with || (fate == Fate::Drop && !is_inside_without) {
            return Ok(());
        }
        for k in (0..members.len()).filter(|k| members[*k] && *k != own) {
            if let Some(other) = self.object_at_point(k, at)? {
                self.unite([part, other].into_iter());
            }
        }
        Ok(())
    }

    /// Returns to which object a region of a face belongs. `windings` are those of all operands
    /// above and below the sample, and `faces` all faces that contain it.
    pub(super) fn of_region(
        &self,
        sample: &SamplePoint<'_>,
        windings: [&[i32]; 2],
        faces: &[FaceAtSample],
    ) -> Result<FaceOwner> {
        let members = windings.map(|windings| -> Vec<bool> {
            (windings.iter().zip(&self.operands))
                .map(|(winding, own)| (*winding > 0) != own.is_turned)
                .collect()
        });
        let is_inside = [self.has_object(&members[0]), self.has_object(&members[1])];
        let sides = [0, 1].map(|side| if is_inside[side] { Some(side) } else { None });
        // Per side and operand: the object, and its face at the sample.
        let mut objects = [vec![None; self.operands.len()], vec![None; self.operands.len()]];
        for side in sides.into_iter().flatten() {
            for k in (0..self.operands.len()).filter(|k| members[side][*k]) {
                if self.owner.is_some_and(|owner| owner != k) {
                    continue;
                }
                // (Above the sample is the front of a face that is oriented upwards.)
                let is_of = |face: &&FaceAtSample| {
                    face.operand == k && (usize::from(face.is_up) == side) != self.operands[k].is_turned
                };
                objects[side][k] = match faces.iter().find(is_of) {
                    Some(face) => Some((face.part, Some(face.face))),
                    None if faces.iter().any(|face| face.operand == k) => None,
                    None => self.object_at(k, sample)?.map(|part| (part, None)),
                };
            }
        }
        let are_objects = |k: usize, part: u32| self.operands[k].is_object(part);
        let parts = |side: usize| {
            (objects[side].iter().enumerate())
                .filter_map(|(k, found)| found.map(|(part, _)| part).filter(|part| are_objects(k, *part)))
        };
        if is_inside != [true; 2] {
            let side = usize::from(is_inside[1]);
            if self.owner.is_none() {
                self.unite(parts(side));
            }
            let part = objects[side].iter().flatten().next().map(|(part, _)| *part);
            return Ok(FaceOwner { part, wall: None });
        }
        // Between two objects of one operand is a wall, unless another object is on both sides.
        let is_around = |k: &usize| match [objects[0][*k], objects[1][*k]] {
            [Some((above, None)), Some((below, None))] => above == below,
            _ => false,
        };
        let wall = (0..self.operands.len()).find_map(|k| match [objects[0][k], objects[1][k]] {
            [Some((above, Some(one))), Some((below, Some(other)))]
                if above != below && are_objects(k, above) && are_objects(k, below) =>
            {
                Some(([one, other], self.is_turned != self.operands[k].is_turned))
            }
            _ => None,
        });
        let wall = wall.filter(|_| !(0..self.operands.len()).any(|k| is_around(&k)));
        if self.owner.is_none() {
            match wall {
                Some(_) => [0, 1].into_iter().for_each(|side| self.unite(parts(side))),
                None => self.unite(parts(0).chain(parts(1))),
            }
        }
        Ok(FaceOwner { part: None, wall })
    }

    /// Returns the numbers of all parts in the result. Warns of objects with other names than those
    /// that they are united with, if `warns`.
    pub(super) fn numbers(&self, warns: bool, progress: &dyn Progress) -> PartNumbers {
        let mut united = self.united.lock().expect("no thread panics while it holds this lock");
        let roots = united.roots();
        let mut found = PartNumbers { numbers: Vec::new(), dropped: FaceSet::new(roots.len() as u64) };
        let mut next = 0;
        for (part, root) in (0..).zip(&roots) {
            let k = self.operands.partition_point(|own| own.first + own.count <= part);
            let is_tool = self.owner.is_some_and(|owner| owner != k && self.operands[owner].are_all);
            let is_dropped = is_tool || part != *root;
            found.dropped.set(part.into(), is_dropped);
            // (Roots come first. Those of tools get their numbers below.)
            let number = if is_tool {
                u32::MAX
            } else if is_dropped {
                found.numbers[*root as usize]
            } else {
                next
            };
            found.numbers.push(number);
            next += u32::from(!is_dropped);
        }
        if let Some(owner) = self.owner.map(|owner| &self.operands[owner]) {
            let any =
                found.numbers.get((owner.first + owner.any.unwrap_or(0)) as usize).copied().unwrap_or(0);
            found.numbers.iter_mut().filter(|number| **number == u32::MAX).for_each(|number| *number = any);
        }
        if warns {
            self.warn_united(&roots, progress);
        }
        found
    }

    fn warn_united(&self, roots: &[u32], progress: &dyn Progress) {
        /// Number of names in the warning.
        const MAX_NAMES: usize = 3;
        let named = |part: u32| {
            let k = self.operands.partition_point(|own| own.first + own.count <= part);
            let name = self.models[k].parts().get((part - self.operands[k].first) as usize);
            (k, name.map_or("", String::as_str))
        };
        let lost = (0..).zip(roots).filter(|(part, root)| part != *root && named(*part).1 != named(**root).1);
        let lost: Vec<(u32, u32)> = lost.map(|(part, root)| (part, *root)).collect();
        let Some((first, _)) = lost.first() else { return };
        let mut names: Vec<String> = lost
            .iter()
            .take(MAX_NAMES)
            .map(|(part, root)| format!("{} in {}", named(*part).1, named(*root).1))
            .collect();
        if lost.len() > MAX_NAMES {
            names.push("...".into());
        }
        let text = format!(
            "objects that overlap or share a wall are one object in the result: {}",
            names.join(", ")
        );
        progress.warn(self.models[named(*first).0].path(), &text);
    }
}
