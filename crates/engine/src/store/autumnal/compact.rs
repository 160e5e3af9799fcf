//! Writes some commits of a file to a new one, without the room that the others took.

use std::path::Path;

use super::commit::Commit;
use super::editor::Editor;
use super::history::History;
use super::reader::Autumnal;
use super::write::backend;
use crate::store::builder::{BuildOptions, TreeSink, walk};
use crate::store::records::RecordLayout;
use spinney_base::io::Output;
use spinney_base::{Error, Progress, Result, sort};
use spinney_container::OpenOptions;

/// Selection of the commits that stay.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Keep {
    /// The newest ones, so many.
    Last(u64),
    /// The commits with these numbers.
    Numbers(Vec<u64>),
}

impl Keep {
    /// The commits that stay, the oldest first.
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
            return Err(Error::invalid("commits to keep", "none", "at least one"));
        }
        Ok(kept)
    }
}

/// Writes some commits of a file, with their numbers and notes, to a new one. What they have in common at the
/// same node is written once; equal subtrees anywhere with `share`, or if the file stores them so. Returns
/// the commits as they are in the new file.
///
/// # Errors
/// If there are no such commits, the file is damaged, the output cannot be written, or on interruption.
pub fn compact(
    path: &Path,
    keep: &Keep,
    share: bool,
    mut output: Output,
    memory: u64,
    progress: &dyn Progress,
) -> Result<Vec<Commit>> {
    let history = History::open(path, &OpenOptions::default())?;
    if let Some(remark) = history.remark() {
        progress.warn(path, remark);
    }
    let commits = keep.of(&history)?;
    let file_depth = history.archive.header.depth;
    let share = share || history.is_shared();
    // (What commits have in common is written once.)
    for commit in commits.iter().filter(|_| !share) {
        let mut needed = 0u64;
        for number in 0..commit.layers.len() {
            let tree = Autumnal::new(history.archive.clone(), commit.clone(), number)?;
            let least = RecordLayout::new(tree.header().form).least_node();
            needed = needed.saturating_add(tree.claimed_records()?.saturating_mul(least));
        }
        output.check_room(needed)?;
    }
    let mut made = Vec::new();
    // The commit that was written last: what a commit has in common with it is in the new file.
    let mut before: Option<Commit> = None;
    let mut editor: Option<Editor> = None;
    // The oldest first: each is then written as what differs from the one before.
    for commit in commits {
        for number in 0..commit.layers.len() {
            let tree = Autumnal::new(history.archive.clone(), commit.clone(), number)?;
            let (header, metadata) = (tree.header().clone(), tree.metadata().clone());
            let options = BuildOptions { metadata, share, ..BuildOptions::like(&header, memory) };
            let editor = match &mut editor {
                Some(editor) => editor,
                empty => {
                    let path = output.path().to_path_buf();
                    empty.insert(Editor::create(
                        backend(&mut output)?,
                        path,
                        (&header, file_depth),
                        &options,
                    )?)
                }
            };
            editor.select_or_add(&header, &options.metadata)?;
            // The same layer in the commit before, if it was of the same type.
            let twin = before.as_ref().and_then(|before| {
                let there = before.layer_named(&tree.layer().name)?;
                let is_alike = before.layers[there].header == tree.layer().header;
                is_alike.then(|| Autumnal::new(history.archive.clone(), before.clone(), there))
            });
            let twin = twin.transpose()?;
            let mut fill =
                |sink: &mut dyn TreeSink, shape| walk(&tree, &options, shape, true, sink, progress);
            editor.fill([u64::MAX; 3], &options, twin.as_ref(), &mut fill)?;
            editor.set_metadata(options.metadata)?;
        }
        let (number, note) = (commit.number, commit.note.clone());
        if let Some(editor) = &mut editor {
            editor.keep_only(&commit)?;
            made.push(editor.commit_as(number, note)?);
        }
        before = Some(commit);
    }
    drop(editor);
    output.commit()?;
    Ok(made)
}
