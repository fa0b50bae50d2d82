//! A fitted network as an ONNX file, the same bytes for the same network.
//!
//! `heightfield` f32 `[N, 1, 31, 11]`, metres, centred → `viability` or `cot` f32 `[N, 1]`.

use tract_onnx::pb;
use vocaloco_core::predictor::known_terrain::{self, KnownTerrain};

use super::network::{FLAT, TENSORS};
use super::sgd::Head;
use crate::onnx::{Graph, Rows, fully_connected, initializer, integer, integers, node, value};

/// What an exported file says of itself, in `metadata_props`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Origin {
    /// The skill that the predictor speaks for.
    pub skill: String,
    /// The robot it was collected on.
    pub robot: String,
    /// SHA-256 of the data set.
    pub data_sha256: String,
    /// Seed of the training.
    pub seed: u64,
}

/// The file's bytes; `known` is the terrain that the predictor knows, where it shall say so.
pub fn onnx(parameters: &[f32], head: Head, origin: &Origin, known: Option<&KnownTerrain>) -> Vec<u8> {
    let output = output_name(head);
    let initializers =
        TENSORS.iter().map(|tensor| initializer(tensor.name, tensor.shape, tensor.of(parameters)));
    let mut metadata = vec![
        ("data_sha256", origin.data_sha256.clone()),
        ("kind", output.to_owned()),
        ("robot", origin.robot.clone()),
        ("seed", origin.seed.to_string()),
        ("skill", origin.skill.clone()),
    ];
    metadata.extend(known.map(|known| (known_terrain::KEY, known.to_text())));
    Graph {
        name: "predictor",
        nodes: nodes(head),
        initializers: initializers.collect(),
        input: value("heightfield", Rows::Any, &[1, 31, 11]),
        output: value(output, Rows::Any, &[1]),
        metadata: metadata.into_iter().map(|(key, value)| (key.to_owned(), value)).collect(),
    }
    .encode()
}

/// The output's name, which is also the kind of data it is fitted to.
pub fn output_name(head: Head) -> &'static str {
    match head {
        Head::Sigmoid => "viability",
        Head::Linear => "cot",
    }
}

fn nodes(head: Head) -> Vec<pb::NodeProto> {
    let mut nodes = vec![
        convolution("conv1", "heightfield"),
        node("Relu", &["conv1"], "relu1", vec![]),
        convolution("conv2", "relu1"),
        node("Relu", &["conv2"], "relu2", vec![]),
        node(
            "MaxPool",
            &["relu2"],
            "pool",
            vec![integers("kernel_shape", &[2, 2]), integers("strides", &[2, 2])],
        ),
        convolution("conv3", "pool"),
        node("Relu", &["conv3"], "relu3", vec![]),
        node("Flatten", &["relu3"], "flat", vec![integer("axis", 1)]),
        fully_connected("fc1", "flat", "fc1"),
        node("Relu", &["fc1"], "relu4", vec![]),
        fully_connected("fc2", "relu4", "fc2"),
        node("Relu", &["fc2"], "relu5", vec![]),
    ];
    match head {
        Head::Linear => nodes.push(fully_connected("out", "relu5", output_name(head))),
        Head::Sigmoid => {
            nodes.push(fully_connected("out", "relu5", "logit"));
            nodes.push(node("Sigmoid", &["logit"], output_name(head), vec![]));
        }
    }
    nodes
}

fn convolution(layer: &str, input: &str) -> pb::NodeProto {
    let attributes = vec![
        integers("kernel_shape", &[3, 3]),
        integers("pads", &[1, 1, 1, 1]),
        integers("strides", &[1, 1]),
    ];
    node("Conv", &[input, &format!("{layer}.weight"), &format!("{layer}.bias")], layer, attributes)
}

const _: () = assert!(FLAT == TENSORS[6].shape[1], "the flattened planes are what fc1 takes");

#[cfg(test)]
mod tests {
    use super::*;
    use crate::predictor::network::start_values;
    use crate::predictor::sgd::answers;
    use vocaloco_core::heightfield::Heightfield;
    use vocaloco_core::predictor::{Predictor, Quantity};
    use vocaloco_sim::stream::stream;

    fn origin() -> Origin {
        Origin { skill: "walk".into(), robot: "anymal_d".into(), data_sha256: "00".into(), seed: 1 }
    }

    #[test]
    fn the_file_answers_as_the_kernel_does() {
        let parameters = start_values(&mut stream(3, "test/export", &[]));
        for (head, quantity) in [(Head::Sigmoid, Quantity::Viability), (Head::Linear, Quantity::Cot)] {
            let bytes = onnx(&parameters, head, &origin(), None);
            let mut predictor = Predictor::from_bytes(&bytes, "test.onnx".as_ref(), quantity).unwrap();
            let mut found = Vec::new();
            for k in 0..5 {
                let height = |i: usize, j: usize| 0.1 * k as f32 * (i / (4 + k)) as f32 - 0.03 * j as f32;
                let cells_m = std::array::from_fn(|i| std::array::from_fn(|j| height(i, j)));
                let field = Heightfield { cells_m }.prepare(None).unwrap();
                let answer = predictor.predict(&field).unwrap();
                let wanted = answers(&parameters, head, &[field.as_slice()])[0];
                assert!((answer - wanted).abs() < 1e-5, "{head:?}, field {k}: {answer} against {wanted}");
                found.push(answer);
            }
            assert!(
                (found[0] - found[4]).abs() > 1e-3,
                "{head:?}: fields that cannot be told apart: {found:?}"
            );
        }
    }

    #[test]
    fn the_same_network_gives_the_same_bytes_and_another_origin_other_ones() {
        let parameters = start_values(&mut stream(4, "test/export", &[]));
        let bytes = onnx(&parameters, Head::Linear, &origin(), None);
        assert_eq!(bytes, onnx(&parameters, Head::Linear, &origin(), None));
        assert_ne!(bytes, onnx(&parameters, Head::Linear, &Origin { seed: 2, ..origin() }, None));
    }
}
