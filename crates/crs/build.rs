//! Packs definitions of coordinate systems. They consist of few distinct words, so the packed file
//! is a quarter of the size of the strings.
//!
//! The file begins with three 32-bit numbers: length of the dictionary in bytes, number of
//! definitions, and total number of their words. Then come the dictionary, one word per line; each
//! definition's number as the 16-bit difference from the previous one; each definition's 8-bit word
//! count; and the 16-bit word indices of all definitions. Numbers are little-endian.

use std::collections::BTreeMap;
use std::path::Path;
use std::{env, fs};

/// Systems whose definitions in the list lack the axis order of the registry, south and west.
const SOUTH_WEST: [u16; 2] = [2065, 5513];

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    let known = (0..=u16::MAX).filter_map(crs_definitions::from_code);
    let known: Vec<(u16, Vec<&str>)> = known
        .filter(|known| !known.proj4.is_empty())
        .map(|known| {
            let mut words: Vec<&str> = known.proj4.split(' ').collect();
            if SOUTH_WEST.contains(&known.code) && !words.contains(&"+axis=swu") {
                words.insert(1, "+axis=swu");
            }
            (known.code, words)
        })
        .collect();
    let mut words: BTreeMap<&str, u16> =
        known.iter().flat_map(|(_, words)| words).map(|word| (*word, 0)).collect();
    words.values_mut().zip(0..).for_each(|(number, next)| *number = next);
    let text: String = words.keys().flat_map(|word| [word, "\n"]).collect();
    let all: Vec<u16> = known.iter().flat_map(|(_, own)| own).map(|word| words[word]).collect();
    let mut bytes = Vec::new();
    for count in [text.len(), known.len(), all.len()] {
        bytes.extend(u32::try_from(count).expect("a list of some thousands").to_le_bytes());
    }
    bytes.extend(text.bytes());
    let mut before = 0;
    for (code, _) in &known {
        bytes.extend((code - before).to_le_bytes());
        before = *code;
    }
    bytes.extend(known.iter().map(|(_, own)| u8::try_from(own.len()).expect("a definition of some words")));
    bytes.extend(all.iter().flat_map(|word| word.to_le_bytes()));
    // (A test compares them with the strings. It cannot depend on the list itself: Cargo compiles
    // dependencies of build scripts with other settings than those of tests, and would compile all
    // dependants of this crate again.)
    let strings: String = known.iter().map(|(code, words)| format!("{code} {}\n", words.join(" "))).collect();
    let directory = env::var_os("OUT_DIR").expect("Cargo says where to write");
    for (name, contents) in [("definitions", &bytes[..]), ("definitions.txt", strings.as_bytes())] {
        fs::write(Path::new(&directory).join(name), contents).expect("a file can be written there");
    }
}
