//! Commit that last changed each cell.

use std::path::Path;
use std::sync::Arc;

use super::diff::is_same_record;
use super::tree_file::{TreeFile, TreeFileNode};
use crate::store::autumnal::History;
use crate::store::builder::ReusableSource;
use crate::store::{BuildOptions, WriteOptions, build};
use crate::tree::{Child, Children, Source, no_children};
use spinney_base::io::Output;
use spinney_base::value::{DataKind, Rule, SampleType, Value, ValueType};
use spinney_base::{Error, Progress, Result, TreeType};
use spinney_container::{FileReference, Metadata, Tag};

/// Writes a tree with the number of the commit that last changed each cell of an Autumnal file,
/// from its first commit to the newest or, for `FILE@N`, to that one. Cells that no commit has
/// given a value are VOID. Coarse cells have the newest commit below them.
///
/// Records that commits share are read once. Time is proportional to the tree's nodes and the
/// number of changes, memory to the number of commits, whose roots are held.
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::{Output, WriteOptions};
/// use spinney::raw::ops;
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("age.goblin");
/// ops::blame("fixtures/v1/history.autumn".as_ref(), Output::create(&path)?, WriteOptions::new(64 << 20), &())?;
/// assert_eq!(spinney::open(&path)?.value_bounds()?[0].0, 1.0);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// The file is opened with the output's [access](Output::access).
///
/// # Errors
/// If it is no Autumnal file, cannot be read, has a commit whose number is 2^32 or more, the output
/// cannot be written, or on cancellation.
pub fn blame(path: &Path, output: Output, how: WriteOptions, progress: &dyn Progress) -> Result<()> {
    let options = output.access().into();
    let requested = TreeFile::open_only(path, &options)?;
    let TreeFile::Autumnal(commit) = &requested else {
        let expected = "an Autumnal file (.autumn), which has commits";
        return Err(Error::invalid("file to blame", format!("{}, a Goblin file", path.display()), expected));
    };
    let last = commit.commit().number;
    let place = FileReference::of(path);
    let history = History::open(&place.file, &options)?;
    let depth = requested.depth();
    let mut commits = Vec::new();
    for commit in history.commits() {
        let number = commit?.number;
        if number <= last {
            progress.check()?;
            let place = FileReference { commit: Some(number), ..place.clone() };
            let other = TreeFile::at(&place, &options)?;
            // (Trees of different depths share no nodes.)
            if other.depth() != depth {
                let found = format!("{} at commit {number}", other.depth());
                let expected = format!("{depth}, the depth of commit {last}");
                return Err(Error::invalid("depth of a tree", found, expected));
            }
            commits.push((number, other.root()?));
        }
    }
    commits.reverse();
    let form = TreeType::new(requested.form().dimension, ValueType::new(SampleType::U32, 1));
    // (A record's position in the file does not depend on the commit.)
    let file = TreeFile::at(&FileReference { commit: None, ..place }, &options)?;
    let ages = Ages { file, commits, form, depth };
    let own = requested.metadata();
    let provenance = vec![format!("commits that changed the cells of {} last", path.display())];
    // (Keeps the georeferencing, and drops the meaning of the values.)
    let mut metadata = Metadata {
        frame: own.frame.clone(),
        control_points: own.control_points.clone(),
        band_names: vec!["commit".into()],
        provenance,
        ..Metadata::default()
    };
    if let Some(unit) = own.tag(Tag::Unit) {
        metadata.set_tag(Tag::Unit, unit);
    }
    let options =
        BuildOptions::new(DataKind::Continuous, depth).rule(Rule::Max).written(how).metadata(metadata);
    build(&ages, requested.header().extent, &options, output, progress)?;
    history.check_unchanged()
}

/// Numbers of the commits that last changed each cell.
struct Ages {
    file: TreeFile,
    /// Numbers and roots, oldest first.
    commits: Vec<(u64, Child<TreeFileNode>)>,
    form: TreeType,
    depth: u8,
}

/// States of a node, oldest first, each with the commit that it began with.
///
/// Invariant: consecutive states differ, as far as records show. If all are uniform, the last one
/// began with the commit that last changed the node. If one is INNER, its children are compared in
/// the same way, down to cells.
#[derive(Clone)]
struct States(Arc<[(usize, Child<TreeFileNode>)]>);

impl Ages {
    fn number(&self, commit: usize) -> Result<Value> {
        let number = self.commits[commit].0;
        let value = u32::try_from(number).ok().and_then(|number| self.form.value.splat(number));
        value.ok_or_else(|| Error::invalid("number of a commit", number.to_string(), "less than 2^32"))
    }

    /// Whether a node is the same in two commits, as far as can be decided without visiting its
    /// children.
    fn is_same(&self, a: &(usize, Child<TreeFileNode>), b: &(usize, Child<TreeFileNode>)) -> bool {
        match (&a.1, &b.1) {
            (Child::Void, Child::Void) => true,
            (Child::Leaf(a), Child::Leaf(b)) => a == b,
            (Child::Inner { .. }, Child::Inner { .. }) => is_same_record(&self.file, &a.1, &self.file, &b.1),
            _ => false,
        }
    }

    /// Node with these states.
    fn node(&self, mut states: Vec<(usize, Child<TreeFileNode>)>) -> Result<Child<States>> {
        states.dedup_by(|next, before| self.is_same(before, next));
        let Some((last, newest)) = states.last() else { return Ok(Child::Void) };
        if states.iter().any(|(_, state)| state.is_inner()) {
            let representative = self.number(*last)?;
            return Ok(Child::Inner { representative, node: States(states.into()) });
        }
        // (A node that was VOID in all commits has no age.)
        if states.len() == 1 && matches!(newest, Child::Void) {
            return Ok(Child::Void);
        }
        Ok(Child::Leaf(self.number(*last)?))
    }
}

impl Source for Ages {
    type Node = States;

    fn form(&self) -> TreeType {
        self.form
    }

    fn depth(&self) -> u8 {
        self.depth
    }

    fn root(&self) -> Result<Child<States>> {
        let roots = self.commits.iter().enumerate().map(|(index, (_, root))| (index, *root));
        self.node(roots.collect())
    }

    fn children(&self, node: &States, children: &mut Children<States>) -> Result<()> {
        let count = self.form.children();
        let mut below: Vec<Vec<(usize, Child<TreeFileNode>)>> = vec![Vec::new(); count];
        let mut own = no_children();
        for (commit, state) in node.0.iter() {
            if let Child::Inner { node, .. } = state {
                self.file.children(node, &mut own)?;
            } else {
                own.fill(*state);
            }
            below.iter_mut().zip(&own).for_each(|(states, child)| states.push((*commit, *child)));
        }
        for (child, states) in children.iter_mut().zip(below) {
            *child = self.node(states)?;
        }
        Ok(())
    }

    fn check_unchanged(&self) -> Result<()> {
        self.file.check_unchanged()
    }
}

impl ReusableSource for Ages {}
