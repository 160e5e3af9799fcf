//! Builders that are killed, stopped, or find the disk full leave the old file or the new one,
//! never an intermediate state.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output as Finished, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use spinney::raw::dataset::open;
use spinney::raw::export::image::{Format, ImageSpec, create};
use spinney::{Metadata, Output, SampleType, ValueType};
use tempfile::TempDir;

use crate::common::Random;
use crate::common::command::interruptible;

const SIDE: u64 = 4000;

/// A directory with an image that takes a while to build and the tree of a small one.
struct Setup {
    directory: TempDir,
    raster: PathBuf,
    output: PathBuf,
    old: Vec<u8>,
}

impl Setup {
    fn new() -> Setup {
        let directory = tempfile::tempdir().unwrap();
        let path = |name: &str| directory.path().join(name);
        let (raster, small, output) = (path("large.tif"), path("small.tif"), path("out.goblin"));
        write_noise(&raster, SIDE);
        write_noise(&small, 50);
        assert!(build(&small, &output).wait().unwrap().success());
        let old = std::fs::read(&output).unwrap();
        Setup { directory, raster, output, old }
    }

    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.directory.path()).unwrap();
        let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    /// Checks that nothing has changed and no temporary file remains.
    fn untouched(&self) {
        assert!(std::fs::read(&self.output).unwrap() == self.old);
        assert_eq!(self.files(), ["large.tif", "out.goblin", "small.tif"]);
    }
}

fn write_noise(path: &Path, side: u64) {
    let spec = ImageSpec {
        width: side,
        height: side,
        value: ValueType::new(SampleType::U8, 1),
        alpha: false,
        void: false,
        metadata: Metadata::default(),
    };
    let mut writer = create(Output::create(path).unwrap(), Format::Tiff, &spec).unwrap();
    let mut random = Random(side);
    let row: Vec<u8> = (0..2 * side).map(|_| random.next() as u8).collect();
    for _ in 0..side {
        let start = random.below(side) as usize;
        writer.write_rows(&row[start..][..side as usize], None).unwrap();
    }
    writer.finish().unwrap();
}

const PROGRAM: &str = env!("CARGO_BIN_EXE_spinney");

fn build(input: &Path, output: &Path) -> Child {
    start(Command::new(PROGRAM), input, output)
}

fn start(mut program: Command, input: &Path, output: &Path) -> Child {
    program.args(["build", "--quiet", "--kind", "continuous", "--memory", "64M", "-o"]).args([output, input]);
    program.stderr(Stdio::piped()).spawn().unwrap()
}

/// Builds with a file size limit of some blocks of 512 or 1024 bytes. Exceeding it kills a process
/// that does not ignore or handle the signal.
fn build_within(blocks: u32, setup: &Setup) -> Finished {
    let script = format!("ulimit -f {blocks}; exec \"$@\"");
    let mut command = Command::new("sh");
    command.args(["-c", &script, "sh", PROGRAM, "build", "--quiet", "--kind", "continuous"]);
    command.args(["--memory", "64M", "-o"]).args([&setup.output, &setup.raster]);
    command.output().unwrap()
}

fn signal(child: &Child, name: &str) {
    assert!(Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_killed_builder_leaves_the_old_file_or_the_new_one() {
    let setup = Setup::new();
    let start = Instant::now();
    assert!(build(&setup.raster, &setup.output).wait().unwrap().success());
    let time = start.elapsed();
    let new = std::fs::read(&setup.output).unwrap();
    let mut random = Random(7);
    for _ in 0..5 {
        std::fs::write(&setup.output, &setup.old).unwrap();
        let mut child = build(&setup.raster, &setup.output);
        sleep(time.mul_f64(random.below(1100) as f64 / 1000.0));
        // It may have finished already.
        let _ = child.kill();
        child.wait().unwrap();
        let bytes = std::fs::read(&setup.output).unwrap();
        assert!(bytes == setup.old || bytes == new, "{} bytes", bytes.len());
        assert!(open(&setup.output, &Default::default()).is_ok());
    }
    // The next builder removes the temporary files of killed ones, except those in use.
    let left = |random: &str| setup.directory.path().join(format!(".out.goblin.{random}.partial"));
    std::fs::write(left("abc123"), "left over").unwrap();
    std::fs::write(left("not-ours"), "another program's").unwrap();
    let busy = std::fs::File::create(left("DEF456")).unwrap();
    busy.lock().unwrap();
    assert!(build(&setup.raster, &setup.output).wait().unwrap().success());
    let expected = [".out.goblin.DEF456.partial", ".out.goblin.not-ours.partial"];
    assert_eq!(setup.files()[..2], expected);
    assert_eq!(setup.files()[2..], ["large.tif", "out.goblin", "small.tif"]);
    // Both are complete.
    for bytes in [&setup.old, &new] {
        std::fs::write(&setup.output, bytes).unwrap();
        let tree = open(&setup.output, &Default::default()).unwrap();
        assert_eq!(tree.verify(64 << 20, &()).unwrap(), []);
    }
}

#[test]
fn a_full_disk_is_reported_and_leaves_no_file() {
    let setup = Setup::new();
    for blocks in [0, 1, 100, 10_000] {
        let run = build_within(blocks, &setup);
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{blocks} blocks: {text}");
        assert!(text.contains("out.goblin") && text.contains("File too large"), "{text}");
        setup.untouched();
    }
}

#[test]
fn a_cancelled_build_leaves_no_file() {
    let setup = Setup::new();
    for name in ["INT", "TERM"] {
        let Some(program) = interruptible(PROGRAM) else { return };
        let child = start(program, &setup.raster, &setup.output);
        // The handler must be installed: the temporary file is created after it.
        let start = Instant::now();
        while setup.files().len() == 3 && start.elapsed() < Duration::from_secs(5) {
            sleep(Duration::from_millis(1));
        }
        sleep(Duration::from_millis(50));
        signal(&child, name);
        let run = child.wait_with_output().unwrap();
        let text = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(130), "{name}: {text}");
        assert!(text.contains("interrupted"), "{text}");
        setup.untouched();
    }
}

/// Waits until a builder has begun to write; its handlers are then installed.
fn wait_for_output(setup: &Setup) {
    let start = Instant::now();
    while setup.files().len() == 3 && start.elapsed() < Duration::from_secs(5) {
        sleep(Duration::from_millis(1));
    }
}

#[test]
#[cfg(target_os = "linux")]
fn signals_that_the_parent_ignores_stay_ignored_and_others_clean_up() {
    let setup = Setup::new();
    let ignoring = |names: &str| {
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("trap '' {names}; exec \"$@\""), "sh", PROGRAM]);
        start(shell, &setup.raster, &setup.output)
    };
    // As in the background of a script, or under `nohup`.
    let child = ignoring("INT HUP");
    wait_for_output(&setup);
    for name in ["HUP", "INT", "TERM"] {
        signal(&child, name);
    }
    let run = child.wait_with_output().unwrap();
    assert_eq!(run.status.code(), Some(130), "{}", String::from_utf8_lossy(&run.stderr));
    setup.untouched();
    let child = ignoring("HUP");
    wait_for_output(&setup);
    signal(&child, "HUP");
    assert!(child.wait_with_output().unwrap().status.success());
    assert_eq!(setup.files(), ["large.tif", "out.goblin", "small.tif"]);
}

#[test]
fn a_second_signal_leaves_no_file() {
    let setup = Setup::new();
    for wait in [0, 1, 5] {
        let Some(program) = interruptible(PROGRAM) else { return };
        let child = start(program, &setup.raster, &setup.output);
        wait_for_output(&setup);
        signal(&child, "TERM");
        sleep(Duration::from_millis(wait));
        // It may have finished by now.
        let _ = Command::new("kill").args(["-s", "INT", &child.id().to_string()]).output();
        assert_eq!(child.wait_with_output().unwrap().status.code(), Some(130));
        setup.untouched();
    }
}

#[test]
fn outputs_follow_symbolic_links_and_have_long_names() {
    let setup = Setup::new();
    let small = setup.directory.path().join("small.tif");
    let other = tempfile::tempdir().unwrap();
    let (link, target) = (setup.directory.path().join("link.goblin"), other.path().join("real.goblin"));
    std::os::unix::fs::symlink(&target, &link).unwrap();
    // First without a file at the link's target, then with one.
    for old in [&b""[..], b"old"] {
        if !old.is_empty() {
            std::fs::write(&target, old).unwrap();
        }
        assert!(build(&small, &link).wait().unwrap().success());
        assert!(std::fs::symlink_metadata(&link).unwrap().is_symlink());
        assert!(std::fs::read(&target).unwrap() == setup.old);
    }
    let long = other.path().join(format!("{}.goblin", "n\u{e4}me".repeat(49) + "abc"));
    assert_eq!(long.file_name().unwrap().len(), 255);
    assert!(build(&small, &long).wait().unwrap().success());
    assert_eq!(std::fs::read_dir(other.path()).unwrap().count(), 2);
}

#[test]
#[cfg(target_os = "linux")]
fn devices_are_written_and_not_replaced() {
    use std::os::unix::fs::FileTypeExt;
    let directory = tempfile::tempdir().unwrap();
    let fixture = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/island_classes.tif");
    // A pipe represents all non-files: a test must not put a real device at risk.
    let pipe = directory.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    let reader = std::thread::spawn({
        let pipe = pipe.clone();
        move || std::fs::read(pipe).unwrap()
    });
    let program =
        std::process::Command::new(PROGRAM).args(["-q", "build", fixture, "-o"]).arg(&pipe).status();
    assert!(program.unwrap().success());
    assert!(reader.join().unwrap().starts_with(b"\x93Goblin\n"));
    assert!(std::fs::metadata(&pipe).unwrap().file_type().is_fifo());
}
