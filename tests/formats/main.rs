//! The two file formats: writing, reading, corruption, crashes, and the specification.

#[path = "../common/mod.rs"]
mod common;
#[path = "../../examples/make_fixtures/frozen.rs"]
mod frozen_files;
#[path = "../../examples/make_fixtures/island.rs"]
mod island;
#[allow(dead_code, unreachable_pub)] // what fuzzing alone uses
#[path = "../../fuzz/targets/mod.rs"]
mod targets;

mod access;
mod alpha;
mod attack_autumnal;
mod attack_exact_faces;
mod attack_goblin;
mod attack_layers;
mod attack_levels;
mod attack_lines;
mod attack_model;
mod autumnal;
mod autumnal_corruption;
mod autumnal_crash;
mod autumnal_edits;
mod autumnal_imitations;
mod autumnal_machine;
mod autumnal_malicious;
#[cfg(unix)]
mod autumnal_processes;
mod classes;
mod codes;
mod counted;
mod crafted;
mod dense;
mod faults;
mod fixtures;
mod folded;
mod formats_md;
mod frozen;
mod fuzz_corpus;
mod goblin;
#[cfg(unix)]
mod kill;
mod layers;
mod layers_crash;
mod layers_races;
mod malicious;
mod missing;
mod model_sums;
mod model_verify;
mod packed;
mod packed_history;
mod ranges;
mod rounding;
mod ties;
mod untrusted_operations;
mod wide;
