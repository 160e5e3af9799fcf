//! Default styles of trees.

use serde_json::{Value, json};

use super::{Style, parse};
use spinney_base::value::{DataKind, Rule, SampleType};
use spinney_engine::dataset::Dataset;

/// The default style of a tree.
pub(super) fn style(tree: &Dataset) -> Style {
    parse::of_value(&document(tree)).expect("the built-in document is valid")
}

/// A style that stretches values between two numbers.
pub(super) fn stretched(tree: &Dataset, range: [f64; 2]) -> Style {
    let document = match tree.header().form.value.channels {
        3.. => json!({ "draw": "rgb", "domain": range }),
        2 if is_two_colours(tree) => json!({ "draw": "rgb", "bands": TWO_COLOURS, "domain": range }),
        _ => json!({ "draw": "ramp", "ramp": "grey", "domain": range }),
    };
    // NaN and infinities become null in JSON, which is not a valid domain.
    parse::of_value(&document).unwrap_or_else(|_| style(tree))
}

/// Channels, from 1, for red, green and blue in images with two: the second is cyan.
const TWO_COLOURS: [u8; 3] = [1, 2, 2];

/// Returns whether the two channels have the colour roles red and cyan.
fn is_two_colours(tree: &Dataset) -> bool {
    tree.metadata().colour_roles() == ["Red", "Cyan"]
}

fn document(tree: &Dataset) -> Value {
    let header = tree.header();
    let value = header.form.value;
    if tree.metadata().palette.is_some() {
        return json!({ "draw": "palette" });
    }
    if value.channels == 2 && is_two_colours(tree) {
        return match value.sample {
            SampleType::U8 => json!({ "draw": "rgb", "bands": TWO_COLOURS, "domain": [0, 255] }),
            _ => json!({ "draw": "rgb", "bands": TWO_COLOURS }),
        };
    }
    if value.channels >= 3 {
        return match value.sample {
            SampleType::U8 => json!({ "draw": "rgb", "domain": [0, 255] }),
            _ => json!({ "draw": "rgb" }),
        };
    }
    if header.rule == Rule::Occupancy {
        return json!({ "draw": "ramp", "ramp": ["#d6c2ab00", "#d6c2abff"], "domain": [0, 255] });
    }
    match (header.kind, value.sample) {
        (DataKind::Categorical, _) => json!({ "draw": "palette" }),
        (_, SampleType::U8) => json!({ "draw": "ramp", "ramp": "grey", "domain": [0, 255] }),
        (_, SampleType::U16) => json!({ "draw": "ramp", "ramp": "grey" }),
        _ => json!({ "draw": "ramp", "ramp": "viridis" }),
    }
}
