mod common;
use common::*;
use spinney::space::*;
use spinney::value::*;
#[test]
fn dbg() {
    let cells = Cells::<[u8; 1]>::random(5, [700, 600, 1], 9, true);
    let f = goblin::<Quad, [u8; 1]>(&cells, Rule::Majority, Kind::Categorical);
    for i in 0..f.segments() { let z = f.zone(i).unwrap(); println!("{:?} {:?}", f.entry(i).unwrap().code, z); }
    for code in ["/", "/0"] { let code: Code<Quad> = code.parse().unwrap();
    let mut counts = [0u64; 16];
    cells_below(code, 10).filter_map(|cell| cells.get(cell.map(u64::from))).for_each(|[v]| counts[v as usize]+=1);
    println!("{code} {counts:?}"); }
}
