//! Operations on Goblin files with invalid records that were not verified.

use std::sync::Arc;

use spinney::raw::ops::{self, AffineMap, Axis, Combined, Sampling, View, ViewSource};
use spinney::raw::store::goblin::Goblin;
use spinney::tree::MemTree;
use spinney::{CombineOperation, OpenOptions, Output, Rule, SetOperation};

use crate::common::{self, Random, set_operation};
use crate::malicious::{HEADER, map};

/// Arbitrary, unverified records: the output may be meaningless, but is either written or rejected.
#[test]
fn operations_on_invalid_records_are_harmless() {
    let directory = tempfile::tempdir().unwrap();
    let options = OpenOptions::new().check(false);
    let good = Arc::new(ViewSource::from(Goblin::from_bytes(map().to_vec()).unwrap()));
    let mut random = Random(12);
    for round in 0..120u64 {
        let mut bytes = map().to_vec();
        for _ in 0..1 + round % 5 {
            // The segments follow the header.
            let at = HEADER + random.below(bytes.len() as u64 / 2) as usize;
            bytes[at] ^= 1 << random.below(8);
        }
        let Ok(file) = Goblin::from_backend("map".as_ref(), Box::new(bytes), &options) else { continue };
        let file = Arc::new(ViewSource::from(file));
        let extent = file.header().extent;
        let of = |file: &Arc<ViewSource>| View::new(file.clone(), extent).unwrap();
        let view = || of(&file);
        let views = [
            view(),
            view().window([3, 5, 0], [300, 300, 1]).unwrap(),
            view().transform(&AffineMap::rotation(Axis::Z, 30.0, [9.0; 3])).unwrap(),
            view().scale([0.3, 0.3, 1.0]).unwrap().sampled(Sampling::Area(Rule::Majority)).unwrap(),
        ];
        let view = &views[(round % 4) as usize];
        let header = file.header();
        let options = common::options(header.rule, header.kind, view.depth());
        let output = Output::create(&directory.path().join("made.goblin")).unwrap();
        let alone = Combined::new(vec![view.clone()], CombineOperation::Over, view.extent()).unwrap();
        let _ = ops::build(&alone, &options, output, &());
        let xor = CombineOperation::set(SetOperation::SymmetricDifference);
        let combined = Combined::new(vec![of(&file), of(&file)], xor, extent).unwrap();
        let _ = MemTree::from_source(&combined, Rule::Nearest);
        for number in [6, 7] {
            let set = CombineOperation::set(set_operation(number));
            let combined = Combined::new(vec![of(&good), of(&file)], set, extent).unwrap();
            let options = common::options(header.rule, header.kind, header.shape.depth);
            let output = Output::create(&directory.path().join("made.goblin")).unwrap();
            let _ = ops::build(&combined, &options, output, &());
        }
    }
}
