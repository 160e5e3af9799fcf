//! Writes some commits of a file to a new file, without the space that the others took.

use std::path::Path;

use super::commit::{Commit, CommitLayer};
use super::editor::Editor;
use super::history::History;
use super::reader::Autumnal;
use super::write::backend;
use crate::store::builder::{BuildOptions, TreeSink, walk};
use crate::store::records::RecordLayout;
use spinney_base::io::Output;
use spinney_base::space::CodeRange;
use spinney_base::{Error, Progress, Result, sort};
use spinney_container::TreeFormat;

/// Selection of the commits to keep.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The newest ones, this many.
    Last(u64),
    /// The commits with these numbers.
    Numbers(Vec<u64>),
}

impl Keep {
    /// Returns the commits to keep, the oldest first.
    fn of(&self, history: &History) -> Result<Vec<Commit>> {
        let mut kept = match self {
            Keep::Last(count) => history.commits().take(*count as usize).collect::<Result<Vec<_>>>()?,
            Keep::Numbers(numbers) => {
                numbers.iter().map(|number| history.commit(*number)).collect::<Result<Vec<_>>>()?
            }
        };
        sort::by_key(&mut kept, |commit| commit.number);
        kept.dedup_by_key(|commit| commit.number);
        if kept.is_empty() {
            return Err(Error::invalid("commits to keep", "none", "at least one commit"));
        }
        Ok(kept)
    }
}

/// Options of [`compact`].
#[derive(Clone, Copy, Debug)]
pub struct CompactOptions<'k> {
    keep: &'k Keep,
    share: bool,
    pack: bool,
    memory: u64,
}

impl<'k> CompactOptions<'k> {
    /// Creates options for keeping `keep`, with `memory` in bytes.
    pub fn new(keep: &'k Keep, memory: u64) -> CompactOptions<'k> {
        CompactOptions { keep, share: false, pack: false, memory }
    }

    /// Sets whether equal subtrees anywhere are written once. This is always so if the file stores
    /// them once.
    #[must_use]
    pub fn share(self, share: bool) -> CompactOptions<'k> {
        CompactOptions { share, ..self }
    }

    /// Sets whether to pack history: all records except for those of the newest commit.
    #[must_use]
    pub fn pack(self, pack: bool) -> CompactOptions<'k> {
        CompactOptions { pack, ..self }
    }
}

/// Writes some commits of a file, with their numbers and notes, to a new file. Subtrees that
/// commits share at the same node are written once. Returns the commits of the new file. The old
/// file is read with the output's [access](Output::access).
///
/// ```
/// # std::env::set_current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).unwrap();
/// use spinney::Output;
/// use spinney::raw::store::autumnal::{CompactOptions, Keep, compact};
///
/// # let directory = tempfile::tempdir().unwrap();
/// # let path = directory.path().join("archive.autumn");
/// let keep = Keep::Last(100);
/// let options = CompactOptions::new(&keep, 64 << 20).pack(true);
/// let commits = compact("fixtures/v1/history.autumn".as_ref(), &options, Output::create(&path)?, &())?;
/// assert_eq!(commits.len(), 4);
/// # Ok::<(), spinney::Error>(())
/// ```
///
/// # Errors
/// If the output's name has another extension than `.autumn`, there are no such commits, the file
/// is corrupt, the output cannot be written, or on cancellation.
pub fn compact(
    path: &Path,
    options: &CompactOptions<'_>,
    mut output: Output,
    progress: &dyn Progress,
) -> Result<Vec<Commit>> {
    let name = output.path();
    if name.extension().is_some() && TreeFormat::of(name) != TreeFormat::Autumnal {
        let advice = format!(
            "the result is an Autumnal file: choose a name that ends with .autumn, such as {}",
            name.with_extension("autumn").display()
        );
        return Err(Error::unsupported(name, "an Autumnal file with this extension", advice));
    }
    let history = History::open(path, &output.access().into())?;
    if let Some(remark) = history.remark() {
        progress.warn(path, remark);
    }
    let commits = options.keep.of(&history)?;
    let share = options.share || history.is_shared();
    let options = CompactOptions { share, ..*options };
    // (With sharing, equal subtrees are written once, so the size is unknown.)
    for commit in commits.iter().filter(|_| !share) {
        let mut needed = 0u64;
        for number in 0..commit.layers.len() {
            let tree = Autumnal::new(history.archive.clone(), commit.clone(), number)?;
            let least = RecordLayout::new(tree.header().form).least_node();
            needed = needed.saturating_add(tree.claimed_inner_nodes()?.saturating_mul(least));
        }
        // (Packed history follows the newest commit; its size is not known yet.)
        if !options.pack || Some(commit) == commits.last() {
            output.check_space(needed)?;
        }
    }
    let mut copy =
        Copy { history: &history, options, before: None, editor: None, output: &mut output, progress };
    let made = match options.pack {
        false => copy.oldest_first(commits)?,
        true => copy.newest_first(commits)?,
    };
    drop(copy);
    output.commit()?;
    Ok(made)
}

/// Copy of commits to another file.
struct Copy<'c> {
    history: &'c History,
    options: CompactOptions<'c>,
    /// The commit written last. What a commit shares with it is in the new file.
    before: Option<Commit>,
    editor: Option<Editor>,
    output: &'c mut Output,
    progress: &'c dyn Progress,
}

impl Copy<'_> {
    /// Writes each commit as its differences from the commit before.
    fn oldest_first(&mut self, commits: Vec<Commit>) -> Result<Vec<Commit>> {
        let mut made = Vec::new();
        for commit in commits {
            let (number, note) = (commit.number, commit.note.clone());
            made.push(self.trees(commit)?.commit_as(number, note)?);
        }
        Ok(made)
    }

    /// Writes the newest commit's trees as plain records, then each older commit's trees as packed
    /// differences from the commit after it, and then all commit documents.
    ///
    /// So the newest commit's records are plain, which edits need, and everything else is history.
    fn newest_first(&mut self, commits: Vec<Commit>) -> Result<Vec<Commit>> {
        // Invariant: commit documents follow everything they point to, the oldest first, whatever
        // the order of their records. A kept commit's pointers lead back to earlier bytes, and
        // records that it shares with a newer commit were written before.
        let mut states = Vec::new();
        for commit in commits.into_iter().rev() {
            let (number, note) = (commit.number, commit.note.clone());
            let editor = self.trees(commit)?;
            let state = editor.state()?;
            if states.is_empty() {
                editor.pack()?;
            }
            states.push((state, number, note));
        }
        let Some(editor) = &mut self.editor else { return Ok(Vec::new()) };
        let commits = states.into_iter().rev();
        commits.map(|(state, number, note)| editor.commit_state(state, number, note)).collect()
    }

    /// Writes the trees of a commit.
    fn trees(&mut self, commit: Commit) -> Result<&mut Editor> {
        let Copy { history, options, before, output, progress, .. } = self;
        for number in 0..commit.layers.len() {
            let tree = Autumnal::new(history.archive.clone(), commit.clone(), number)?;
            let (header, metadata) = (tree.header().clone(), tree.metadata().clone());
            let like = BuildOptions::like(&header, options.memory);
            let build = BuildOptions { metadata, share: options.share, ..like };
            let editor = match &mut self.editor {
                Some(editor) => editor,
                empty => {
                    let path = output.path().to_path_buf();
                    let of = (&header, history.archive.header.depth);
                    empty.insert(Editor::create(backend(output)?, path, of, &build, options.pack)?)
                }
            };
            // (An only layer without a name was named when another layer was added.)
            let name = &*tree.layer().name;
            editor.follow_name(name)?;
            editor.select_or_add(&header, &build.metadata)?;
            // The same layer in the commit before, if it had the same type.
            let twin = before.as_ref().and_then(|before| {
                let unnamed = |layer: &CommitLayer| layer.name.is_empty() || name.is_empty();
                let first = (number == 0 && unnamed(&before.layers[0])).then_some(0);
                let there = before.layer_named(name).or(first)?;
                let is_alike = before.layers[there].header == tree.layer().header;
                is_alike.then(|| Autumnal::new(history.archive.clone(), before.clone(), there))
            });
            let twin = twin.transpose()?;
            let mut fill = |sink: &mut dyn TreeSink, shape| {
                walk(&tree, &build, (shape, CodeRange::ALL), true, sink, *progress)
            };
            editor.fill([u64::MAX; 3], &build, twin.as_ref(), &mut fill)?;
            editor.set_metadata(build.metadata)?;
        }
        let Some(editor) = &mut self.editor else {
            return Err(Error::invalid("commit", "no layers", "at least one layer"));
        };
        editor.keep_only(&commit)?;
        self.before = Some(commit);
        Ok(editor)
    }
}
