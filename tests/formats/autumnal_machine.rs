//! Random sequences of edits, reverts, compactions, moves, replacements and crashes of Autumnal
//! files, checked against a map from commit numbers to cells.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Mutex;

use spinney::edit::{Edit, Editor, Note, edit};
use spinney::raw::dataset;
use spinney::raw::ops::apply_edits;
use spinney::raw::store::autumnal::{Autumnal, CompactOptions, History, Keep, compact};
use spinney::{
    DataKind, Error, OpenOptions, Output, Progress, Rule, SampleType, TreeType, WriteOptions, convert,
};
use tempfile::TempDir;

use super::autumnal_edits::{random_edit, write};
use crate::common::{Cells, OCT, QUAD, Random, assert_same, cells_of, quad};
use crate::targets::disk::Disk;

const MEMORY: u64 = 16 << 20;

/// The expected state of a file.
#[derive(Clone)]
struct Model {
    path: PathBuf,
    /// Cells by number of commit.
    commits: BTreeMap<u64, Rc<Cells>>,
    /// Whether a meta slot may be torn.
    has_crashed: bool,
}

impl Model {
    fn newest(&self) -> (u64, Rc<Cells>) {
        let (number, cells) = self.commits.last_key_value().unwrap();
        (*number, cells.clone())
    }

    /// Records a commit that was made.
    fn commit(&mut self, cells: Cells) {
        let number = self.newest().0 + 1;
        self.commits.insert(number, Rc::new(cells));
    }

    fn commit_path(&self, number: u64) -> PathBuf {
        format!("{}@{number}", self.path.display()).into()
    }
}

/// Files, and readers that were opened earlier and see their commits.
struct Machine {
    random: Random,
    directory: TempDir,
    /// A directory for trees used in edits.
    others: TempDir,
    files: Vec<Model>,
    readers: Vec<(Autumnal, Rc<Cells>)>,
    names: u32,
}

/// Runs an action as soon as an operation has begun.
struct Meanwhile<'a>(Mutex<Option<Box<dyn FnOnce() + Send + 'a>>>);

impl<'a> Meanwhile<'a> {
    fn new(action: impl FnOnce() + Send + 'a) -> Meanwhile<'a> {
        Meanwhile(Mutex::new(Some(Box::new(action))))
    }
}

impl Progress for Meanwhile<'_> {
    fn advance(&self, _: u64, _: u64) {
        if let Some(action) = self.0.lock().unwrap().take() {
            action();
        }
    }
}

fn open(path: &Path) -> Autumnal {
    Autumnal::open(path, &OpenOptions::new()).unwrap_or_else(|error| panic!("{error}"))
}

impl Machine {
    fn new(seed: u64, form: TreeType, size: [u64; 3], what: (Rule, DataKind)) -> Machine {
        let [directory, others] = [(), ()].map(|()| tempfile::tempdir().unwrap());
        let cells = Cells::random(form, seed, size, 4, true);
        let path = directory.path().join("0.autumn");
        write(&path, &cells, what, seed.is_multiple_of(2));
        let commits = BTreeMap::from([(1, Rc::new(cells))]);
        let files = vec![Model { path, commits, has_crashed: false }];
        Machine { random: Random(seed), directory, others, files, readers: Vec::new(), names: 0 }
    }

    /// Returns an unused path.
    fn new_path(&mut self) -> PathBuf {
        self.names += 1;
        self.directory.path().join(format!("{}.autumn", self.names))
    }

    fn any_file(&mut self) -> usize {
        self.random.below(self.files.len() as u64) as usize
    }

    /// Returns random edits of a file, and its cells after them.
    fn edits(&mut self, file: usize) -> (Vec<Edit>, Cells) {
        let mut cells = (*self.files[file].newest().1).clone();
        let count = 1 + self.random.below(2);
        let edits =
            (0..count).map(|_| random_edit(&mut self.random, self.others.path(), &mut cells)).collect();
        (edits, cells)
    }

    fn step(&mut self) -> &'static str {
        let file = self.any_file();
        match self.random.below(12) {
            0..=2 => self.edit(file),
            3 => self.revert(file),
            4 => self.compact(file),
            5 => self.rename(file),
            6 => self.crash(file),
            7 => self.lose_path(file),
            8 => self.find_target_taken(file),
            9 => self.find_editor(file),
            10 => self.replace(file),
            _ => self.begin_reading(file),
        }
    }

    fn edit(&mut self, file: usize) -> &'static str {
        let (edits, cells) = self.edits(file);
        let model = &mut self.files[file];
        let commit = edit(&model.path, edits.into_iter().map(Ok), Note::default(), MEMORY, &()).unwrap();
        match commit {
            Some(commit) => {
                model.commit(cells);
                assert_eq!(commit.number, model.newest().0);
            }
            None => assert_same(&cells, &model.newest().1, "nothing changed"),
        }
        "edit"
    }

    fn revert(&mut self, file: usize) -> &'static str {
        let number = self.any_commit(file);
        let model = &mut self.files[file];
        let cells = (*model.commits[&number]).clone();
        let done = edit(&model.path, [Ok(Edit::Revert(number))], Note::default(), MEMORY, &()).unwrap();
        if done.is_some() {
            model.commit(cells);
        }
        // Commits that compaction removed are gone.
        let gone = (1..number).find(|number| !model.commits.contains_key(number)).unwrap_or(u64::MAX);
        assert!(edit(&model.path, [Ok(Edit::Revert(gone))], Note::default(), MEMORY, &()).is_err());
        "revert"
    }

    fn any_commit(&mut self, file: usize) -> u64 {
        let numbers: Vec<u64> = self.files[file].commits.keys().copied().collect();
        numbers[self.random.below(numbers.len() as u64) as usize]
    }

    /// Copies some commits to another file, which may replace the first.
    fn compact(&mut self, file: usize) -> &'static str {
        let target = self.new_path();
        let model = self.files[file].clone();
        let (keep, kept) = if self.random.below(2) == 0 {
            let count = 1 + self.random.below(3);
            (Keep::Last(count), model.commits.keys().rev().take(count as usize).copied().collect::<Vec<_>>())
        } else {
            let numbers: Vec<u64> = (0..3).map(|_| self.any_commit(file)).collect();
            (Keep::Numbers(numbers.clone()), numbers)
        };
        let share = self.random.below(2) == 0;
        // Half of the files have their history packed, and are edited further.
        let pack = self.random.below(2) == 0;
        let options = CompactOptions::new(&keep, MEMORY).share(share).pack(pack);
        compact(&model.path, &options, Output::create(&target).unwrap(), &()).unwrap();
        let commits = model.commits.into_iter().filter(|(number, _)| kept.contains(number)).collect();
        if self.random.below(2) == 0 {
            std::fs::rename(&target, &model.path).unwrap();
            self.files[file].commits = commits;
            self.files[file].has_crashed = false;
            return "compact in place";
        }
        self.files.push(Model { path: target, commits, has_crashed: false });
        "compact"
    }

    fn rename(&mut self, file: usize) -> &'static str {
        let path = self.new_path();
        std::fs::rename(&self.files[file].path, &path).unwrap();
        assert!(Autumnal::open(&self.files[file].path, &OpenOptions::new()).is_err());
        self.files[file].path = path;
        "move"
    }

    /// The disk fails at a write or sync of an edit, half of which arrives.
    fn crash(&mut self, file: usize) -> &'static str {
        let (edits, cells) = self.edits(file);
        let good = self.random.below(8) as usize;
        let model = &mut self.files[file];
        let disk = Disk::new(std::fs::read(&model.path).unwrap());
        disk.state().good = good;
        let done = disk.editor().and_then(|mut editor| {
            apply_edits(&mut editor, &mut edits.into_iter().map(Ok), &())?;
            editor.commit(Note::default())
        });
        // Readers have the file mapped, so it is written in place, as editors do.
        let mut written = std::fs::File::options().write(true).open(&model.path).unwrap();
        written.write_all(&disk.state().bytes).unwrap();
        model.has_crashed = true;
        let number = open(&model.path).commit().number;
        match done {
            Ok(None) => assert_eq!(number, model.newest().0),
            Ok(Some(commit)) => {
                model.commit(cells);
                assert_eq!((commit.number, number), (model.newest().0, model.newest().0));
            }
            Err(error) => {
                assert!(matches!(error, Error::Io { .. }), "{error}");
                // A commit that was not reported may still exist.
                if number > model.newest().0 {
                    model.commit(cells);
                }
                assert_eq!(number, model.newest().0);
            }
        }
        "crash"
    }

    /// The file is moved or replaced during an edit: the commit fails and is not stored in any
    /// file.
    fn lose_path(&mut self, file: usize) -> &'static str {
        let (edits, _) = self.edits(file);
        let path = self.new_path();
        let is_replaced = self.random.below(2) == 0;
        let other = self.any_file();
        let old = self.files[file].path.clone();
        let mut editor = Editor::open(&old, MEMORY).unwrap();
        apply_edits(&mut editor, &mut edits.into_iter().map(Ok), &()).unwrap();
        // A file with a second name is found there.
        std::fs::rename(&old, &path).unwrap();
        if is_replaced {
            let source = if other == file { &path } else { &self.files[other].path };
            std::fs::copy(source, &old).unwrap();
        }
        match editor.commit(Note::default()) {
            // Without changes nothing is written.
            Ok(None) => {}
            Err(Error::Moved { .. }) => {}
            other => panic!("{other:?}"),
        }
        drop(editor);
        self.files[file].path = path;
        if is_replaced {
            self.files.push(Model { path: old, ..self.files[other].clone() });
        }
        "lose the path"
    }

    /// A file appears at an output's path while the output is written: it stays.
    fn find_target_taken(&mut self, file: usize) -> &'static str {
        let target = self.new_path();
        let source = self.files[file].path.clone();
        let appear = Meanwhile::new(|| assert!(std::fs::copy(&source, &target).is_ok()));
        let output = Output::create(&target).unwrap();
        let refused = if self.random.below(2) == 0 {
            compact(&source, &CompactOptions::new(&Keep::Last(2), MEMORY), output, &appear).map(drop)
        } else {
            convert(&source, false, output, WriteOptions::new(MEMORY), &appear)
        };
        drop(appear);
        if target.exists() {
            let refused = refused.unwrap_err().to_string();
            assert!(refused.contains("another process has created"), "{refused}");
        } else {
            panic!("no progress was reported");
        }
        self.files.push(Model { path: target, ..self.files[file].clone() });
        "find the target taken"
    }

    fn find_editor(&mut self, file: usize) -> &'static str {
        let path = &self.files[file].path;
        let editor = Editor::open(path, MEMORY).unwrap();
        assert!(matches!(Editor::open(path, MEMORY), Err(Error::Locked { .. })));
        drop(editor);
        "find an editor"
    }

    /// A copy of another file replaces a file.
    fn replace(&mut self, file: usize) -> &'static str {
        let (other, copy) = (self.any_file(), self.new_path());
        std::fs::copy(&self.files[other].path, &copy).unwrap();
        std::fs::rename(&copy, &self.files[file].path).unwrap();
        let path = self.files[file].path.clone();
        self.files[file] = Model { path, ..self.files[other].clone() };
        "replace"
    }

    fn begin_reading(&mut self, file: usize) -> &'static str {
        let (number, cells) = self.files[file].newest();
        let reader = open(&self.files[file].path);
        assert_eq!(reader.commit().number, number);
        self.readers.push((reader, cells));
        "begin to read"
    }

    /// Checks that opened files are unchanged. Some readers then move to the file that is at their
    /// path now.
    fn check_readers(&mut self) {
        while self.readers.len() > 3 {
            self.readers.remove(0);
        }
        for (reader, cells) in &mut self.readers {
            assert_same(&cells_of(reader, cells.size), cells, "a reader");
            if self.random.below(6) == 0 {
                let there = self.files.iter().find(|model| model.path == reader.path());
                match (reader.refresh(), there) {
                    (Ok(_), Some(model)) => {
                        *cells = model.newest().1;
                        assert_eq!(reader.commit().number, model.newest().0);
                    }
                    (Err(_), None) => {}
                    (refreshed, there) => panic!("{refreshed:?}, {}", there.is_some()),
                }
            }
        }
    }

    /// Checks that a file has its model's commits: `all` of them, or two.
    fn check(&mut self, file: usize, all: bool) {
        let some = self.any_commit(file);
        let model = &self.files[file];
        let history = History::open(&model.path, &OpenOptions::new()).unwrap();
        let numbers: Vec<u64> = history.commits().map(|commit| commit.unwrap().number).collect();
        let expected: Vec<u64> = model.commits.keys().rev().copied().collect();
        assert_eq!(numbers, expected, "{}", model.path.display());
        for (number, cells) in &model.commits {
            if all || *number == some || *number == model.newest().0 {
                let tree = open(&model.commit_path(*number));
                assert_same(&cells_of(&tree, cells.size), cells, "a commit");
            }
        }
        if all {
            let tree = dataset::open(&model.path, &OpenOptions::new()).unwrap();
            let mut findings = tree.verify(MEMORY, &()).unwrap();
            findings.retain(|finding| !(model.has_crashed && finding.place.contains("meta slot")));
            assert_eq!(findings, []);
        }
    }

    fn run(&mut self, steps: usize) {
        for step in 0..steps {
            let done = self.step();
            println!("step {step}: {done}, {} files", self.files.len());
            while self.files.len() > 4 {
                let model = self.files.remove(0);
                std::fs::remove_file(model.path).unwrap();
            }
            for file in 0..self.files.len() {
                self.check(file, step % 10 == 9);
            }
            self.check_readers();
            // No temporary file is left.
            assert_eq!(std::fs::read_dir(self.directory.path()).unwrap().count(), self.files.len());
        }
    }
}

#[test]
fn any_order_of_steps_on_quadtrees() {
    Machine::new(1, QUAD, [40, 33, 1], (Rule::Majority, DataKind::Categorical)).run(150);
    Machine::new(2, quad(SampleType::I16, 1), [70, 20, 1], (Rule::Mean, DataKind::Continuous)).run(150);
}

#[test]
fn any_order_of_steps_on_octrees() {
    Machine::new(3, OCT, [12, 9, 17], (Rule::Occupancy, DataKind::Continuous)).run(100);
    Machine::new(4, OCT, [20, 7, 5], (Rule::Dominant, DataKind::Categorical)).run(100);
}
