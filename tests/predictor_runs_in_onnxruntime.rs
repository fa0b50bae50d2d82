//! A predictor's file, unmodified, passes onnx's checker and gives in Python's onnxruntime what the
//! training kernel gives, to 1e-5, and what the shipped ones give at run time, to 5e-5.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use vocaloco_core::heightfield::{Field, Heightfield};
use vocaloco_core::predictor::{Predictor, Quantity};
use vocaloco_sim::stream::{stream, uniform};
use vocaloco_train::predictor::export::{Origin, onnx, output_name};
use vocaloco_train::predictor::network::start_values;
use vocaloco_train::predictor::sgd::{Head, answers};

const TRAINED: f64 = 1e-5;
/// At run time the weights of the fully connected layers are kept in two bytes.
const RUNNING: f64 = 5e-5;
const HEADS: [(Head, Quantity); 2] = [(Head::Sigmoid, Quantity::Viability), (Head::Linear, Quantity::Cot)];

/// Stairs, walls and noise, different in both axes.
fn fields() -> Vec<Field> {
    (0..24)
        .map(|k| {
            let mut rng = stream(1, "test/onnxruntime", &[k]);
            let (rise, depth) = (uniform(&mut rng, -0.4, 0.4), uniform(&mut rng, 2.0, 6.0));
            let cells_m = std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    rise * (i as f32 / depth).floor() + 0.01 * j as f32 + uniform(&mut rng, -0.1, 0.1)
                })
            });
            Heightfield { cells_m }.prepare(None).expect("a field without unknown cells")
        })
        .collect()
}

fn in_onnxruntime(models: &[PathBuf], fields: &[Field]) -> serde_json::Value {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("peers/predictor_in_onnxruntime.py");
    let mut child = Command::new("python3")
        .arg(script)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3 is installed");
    let cells: Vec<&[f32]> = fields.iter().map(|field| field.as_slice().as_slice()).collect();
    let request = serde_json::json!({ "models": models, "fields": cells });
    let mut stdin = child.stdin.take().expect("a piped stdin");
    stdin.write_all(request.to_string().as_bytes()).expect("python3 reads its input");
    drop(stdin);
    let output = child.wait_with_output().expect("python3 ends");
    assert!(output.status.success(), "python3 with onnx and onnxruntime; its error is above");
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn compare(what: &str, found: &serde_json::Value, wanted: &[f32], tolerance: f64) {
    let found = found.as_array().unwrap_or_else(|| panic!("{what}: no outputs"));
    assert_eq!(found.len(), wanted.len(), "{what}");
    for (k, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        let difference = (found.as_f64().expect("a number") - f64::from(*wanted)).abs();
        assert!(difference < tolerance, "{what}, field {k}: {found} against {wanted}");
    }
}

#[test]
fn exported_networks_answer_as_the_training_kernel() {
    let folder = tempfile::tempdir().unwrap();
    let fields = fields();
    let cells: Vec<_> = fields.iter().map(Field::as_slice).collect();
    let (mut files, mut wanted) = (Vec::new(), Vec::new());
    for (seed, (head, _)) in (1..).zip(HEADS) {
        let parameters = start_values(&mut stream(seed, "test/onnxruntime", &[]));
        let origin =
            Origin { skill: "test".into(), robot: "anymal_d".into(), data_sha256: String::new(), seed };
        let file = folder.path().join(format!("{}.onnx", output_name(head)));
        std::fs::write(&file, onnx(&parameters, head, &origin, None)).unwrap();
        files.push(file);
        wanted.push(answers(&parameters, head, &cells));
    }
    let told = in_onnxruntime(&files, &fields);
    for (file, wanted) in files.iter().zip(&wanted) {
        let name = file.display().to_string();
        compare(&name, &told["outputs"][&name], wanted, TRAINED);
    }
}

#[test]
fn shipped_networks_answer_as_the_runtime_loads_them() {
    let skills = Path::new(env!("CARGO_MANIFEST_DIR")).join("../skills");
    let fields = fields();
    let mut files: Vec<(PathBuf, Quantity)> = Vec::new();
    for skill in std::fs::read_dir(skills).unwrap() {
        for (_, quantity) in HEADS {
            files
                .push((skill.as_ref().unwrap().path().join(format!("{}.onnx", quantity.output())), quantity));
        }
    }
    files.retain(|(file, _)| file.exists());
    assert!(!files.is_empty(), "no skill ships a predictor");
    let told = in_onnxruntime(&files.iter().map(|(file, _)| file.clone()).collect::<Vec<_>>(), &fields);
    for (file, quantity) in files {
        let mut predictor = Predictor::load(&file, quantity).unwrap();
        let wanted: Vec<f32> = fields.iter().map(|field| predictor.predict(field).unwrap()).collect();
        let name = file.display().to_string();
        compare(&name, &told["outputs"][&name], &wanted, RUNNING);
    }
}
