//! An ONNX file is what its card says, and no more than fits.

use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use tract_onnx::pb;
use tract_onnx::prelude::*;

use super::super::ModelCard;
use super::{OPERATOR_SETS, damaged, one_line};
use crate::fault::Fault;

/// Numbers in any one tensor: 256 MiB of f32.
const LARGEST_TENSOR: usize = 1 << 26;
/// Sides of the input, px.
const SIDES: std::ops::RangeInclusive<usize> = 8..=4096;
/// Operators whose output is as large as the values of their last input say.
const GROWING: [&str; 3] = ["ConstantOfShape", "Expand", "Tile"];

/// A network ready to run, width and height of its input and of its outputs.
pub(super) type Prepared = (Arc<TypedRunnableModel>, [usize; 2], [usize; 2]);

/// Checks a file and optimises it.
pub(super) fn prepare(bytes: &[u8], path: &Path, card: &ModelCard) -> Result<Prepared, Fault> {
    let broken = |error: TractError| damaged(path, &one_line(&error));
    let proto = tract_onnx::onnx().proto_model_for_read(&mut &*bytes).map_err(broken)?;
    let uncertainty = card.uncertainty.as_ref().map(|output| output.name.as_str());
    let wanted: Vec<&str> = std::iter::once(card.depth.name.as_str()).chain(uncertainty).collect();
    let input = check_file(&proto, path, &card.input.name, &wanted)?;
    let mut model = tract_onnx::onnx().model_for_proto_model(&proto).map_err(broken)?;
    model.select_outputs_by_name(&wanted).map_err(broken)?;
    let model = model.into_typed().map_err(broken)?;
    let output = check_shapes(&model, path, &wanted, input)?;
    let plan = model.into_optimized().and_then(|model| model.into_runnable()).map_err(broken)?;
    Ok((plan, input, output))
}

/// What can be said before tract works on it; gives width and height of the input.
fn check_file(proto: &pb::ModelProto, path: &Path, input: &str, wanted: &[&str]) -> Result<[usize; 2], Fault> {
    let unfit = |what: String, remedy: &str| Fault::malformed(path, what, remedy);
    let graph = proto.graph.as_ref().ok_or_else(|| damaged(path, "it holds no graph"))?;
    let set = proto.opset_import.iter().find(|set| set.domain.is_empty() || set.domain == "ai.onnx").map_or(0, |set| set.version);
    if !OPERATOR_SETS.contains(&set) {
        let what = format!("is written in ONNX operator set {set}, not one of {} to {}", OPERATOR_SETS.start(), OPERATOR_SETS.end());
        return Err(unfit(what, "export it with opset_version=17"));
    }
    let is_elsewhere = |tensor: &&pb::TensorProto| tensor.data_location.is_some_and(|place| place != 0) || !tensor.external_data.is_empty();
    if let Some(tensor) = graph.initializer.iter().find(is_elsewhere) {
        return Err(unfit(format!("keeps its tensor `{}` in another file", tensor.name), "export it with all data in the ONNX file"));
    }
    if let Some(operator) = grows_too_much(graph) {
        return Err(unfit(format!("an {operator} in it would make more than {LARGEST_TENSOR} numbers at once"), "give a smaller network"));
    }
    // A graph may list its constants among its inputs.
    let constants: HashSet<&str> = graph.initializer.iter().map(|tensor| tensor.name.as_str()).collect();
    let inputs: Vec<&pb::ValueInfoProto> = graph.input.iter().filter(|input| !constants.contains(input.name.as_str())).collect();
    let [image] = inputs[..] else {
        return Err(unfit(format!("has {} inputs ({})", inputs.len(), names(&inputs)), "give a network whose only input is a grey image"));
    };
    if image.name != input {
        let what = format!("has no input `{input}` but `{}`", image.name);
        return Err(unfit(what, "correct [input] name in the .toml beside it"));
    }
    let size = sides(image)
        .map_err(|what| unfit(format!("input `{}` {what}", image.name), "export it for one grey image, 1 x 1 x height x width, f32"))?;
    if !size.iter().all(|side| SIDES.contains(side)) {
        let what = format!("takes an image of {}x{} pixels, not {} to {} on a side", size[0], size[1], SIDES.start(), SIDES.end());
        return Err(unfit(what, "export it for an image of a few hundred pixels"));
    }
    let outputs: Vec<&pb::ValueInfoProto> = graph.output.iter().collect();
    if let Some(name) = wanted.iter().find(|name| !outputs.iter().any(|output| output.name == **name)) {
        return Err(unfit(format!("has no output `{name}` but {}", names(&outputs)), "correct the names in the .toml beside it"));
    }
    // tract panics on an output that nobody computes.
    let made: HashSet<&str> = graph.node.iter().flat_map(|node| &node.output).map(String::as_str).collect();
    match outputs.iter().find(|output| !made.contains(output.name.as_str())) {
        Some(output) => Err(damaged(path, &format!("nothing computes its output `{}`", output.name))),
        None => Ok(size),
    }
}

/// Types and shapes that follow from those of the input; gives width and height of the outputs.
fn check_shapes(model: &TypedModel, path: &Path, wanted: &[&str], input: [usize; 2]) -> Result<[usize; 2], Fault> {
    let unfit = |what: String, remedy: &str| Fault::malformed(path, what, remedy);
    let remedy = "export both outputs as 1 x 1 x rows x columns, f32, not larger than the image";
    let mut size = None;
    for (outlet, name) in model.outputs.iter().zip(wanted) {
        let fact = model.outlet_fact(*outlet).map_err(|error| damaged(path, &one_line(&error)))?;
        if fact.datum_type != f32::datum_type() {
            return Err(unfit(format!("output `{name}` is of type {:?}, not f32", fact.datum_type), remedy));
        }
        let Some([1, 1, rows, columns]) = fact.shape.as_concrete() else {
            return Err(unfit(format!("output `{name}` has the shape {:?}, not 1 x 1 x rows x columns", fact.shape), remedy));
        };
        if !(2..=input[0]).contains(columns) || !(2..=input[1]).contains(rows) {
            return Err(unfit(format!("output `{name}` has {columns}x{rows} pixels for an image of {}x{}", input[0], input[1]), remedy));
        }
        if *size.get_or_insert([*columns, *rows]) != [*columns, *rows] {
            return Err(unfit(format!("outputs `{}` and `{name}` differ in size", wanted[0]), remedy));
        }
    }
    for node in model.nodes() {
        for fact in node.outputs.iter().map(|outlet| &outlet.fact) {
            let count = fact.shape.as_concrete().and_then(|shape| shape.iter().try_fold(1_usize, |count, side| count.checked_mul(*side)));
            if count.is_none_or(|count| count > LARGEST_TENSOR) {
                let what = format!("`{}` would make more than {LARGEST_TENSOR} numbers at once ({:?})", node.name, fact.shape);
                return Err(unfit(what, "give a smaller network"));
            }
        }
    }
    size.ok_or_else(|| damaged(path, "it has no outputs"))
}

fn names(values: &[&pb::ValueInfoProto]) -> String {
    values.iter().map(|value| format!("`{}`", value.name)).collect::<Vec<_>>().join(", ")
}

/// Width and height of a value of the shape 1 x 1 x height x width, f32; otherwise what it is instead.
fn sides(value: &pb::ValueInfoProto) -> Result<[usize; 2], String> {
    let Some(pb::type_proto::Value::TensorType(tensor)) = value.r#type.as_ref().and_then(|kind| kind.value.as_ref()) else {
        return Err("has no type".into());
    };
    if tensor.elem_type != pb::tensor_proto::DataType::Float as i32 {
        let kind = pb::tensor_proto::DataType::try_from(tensor.elem_type);
        return Err(format!("is of type {}, not f32", kind.map_or_else(|_| "unknown".into(), |kind| format!("{kind:?}").to_lowercase())));
    }
    let shape: Vec<Option<usize>> = tensor
        .shape
        .iter()
        .flat_map(|shape| &shape.dim)
        .map(|side| match &side.value {
            Some(pb::tensor_shape_proto::dimension::Value::DimValue(side)) => usize::try_from(*side).ok(),
            _ => None,
        })
        .collect();
    if let [Some(1), Some(1), Some(height), Some(width)] = shape[..] {
        return Ok([width, height]);
    }
    let said: Vec<String> = shape.iter().map(|side| side.map_or_else(|| "?".into(), |side| side.to_string())).collect();
    Err(format!("has the shape {}, not 1 x 1 x height x width", said.join(" x ")))
}

/// An operator that spreads something over a constant shape which is too large: tract would do so while it reads the file.
fn grows_too_much(graph: &pb::GraphProto) -> Option<&str> {
    let of_nodes = graph.node.iter().filter(|node| node.op_type == "Constant").filter_map(|node| {
        let tensor = node.attribute.iter().find_map(|attribute| attribute.t.as_ref())?;
        Some((node.output.first()?.as_str(), tensor))
    });
    let constants: HashMap<&str, &pb::TensorProto> =
        graph.initializer.iter().map(|tensor| (tensor.name.as_str(), tensor)).chain(of_nodes).collect();
    let is_too_large = |tensor: &pb::TensorProto| {
        let raw = tensor.raw_data.chunks_exact(8).filter_map(|bytes| bytes.try_into().ok()).map(i64::from_le_bytes);
        let mut sides = raw.chain(tensor.int64_data.iter().copied()).map(|side| usize::try_from(side).unwrap_or(1).max(1));
        sides.try_fold(1_usize, usize::checked_mul).is_none_or(|size| size > LARGEST_TENSOR)
    };
    let shape_of = |node: &pb::NodeProto| node.input.last().and_then(|shape| constants.get(shape.as_str()).copied());
    let mut growing = graph.node.iter().filter(|node| GROWING.contains(&node.op_type.as_str()));
    growing.find(|node| shape_of(node).is_some_and(is_too_large)).map(|node| node.op_type.as_str())
}
