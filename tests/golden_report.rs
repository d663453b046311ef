//! The tensors of a golden file, and the table of largest errors.

use std::collections::BTreeMap;

use safetensors::SafeTensors;
use safetensors::tensor::Dtype;

/// The cases of one model.
pub(crate) struct Cases<'a> {
    bytes: &'a [u8],
    tensors: SafeTensors<'a>,
}

impl<'a> Cases<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, tensors: SafeTensors::deserialize(bytes).unwrap() }
    }

    /// Number of cases in the file's metadata.
    pub(crate) fn listed(&self) -> usize {
        let (_, metadata) = SafeTensors::read_metadata(self.bytes).unwrap();
        let text = &metadata.metadata().as_ref().expect("golden files have metadata")["cases"];
        serde_json::from_str::<BTreeMap<String, serde_json::Value>>(text).unwrap().len()
    }

    /// The names of all cases.
    pub(crate) fn names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.tensors.names().iter().map(|name| name.split('.').next().unwrap().to_owned()).collect();
        names.sort();
        names.dedup();
        names
    }

    /// The names of a case's outputs, sorted.
    pub(crate) fn outputs(&self, case: &str) -> Vec<String> {
        let prefix = format!("{case}.out.");
        let names = self.tensors.names();
        let mut names: Vec<String> =
            names.iter().filter_map(|name| name.strip_prefix(&prefix)).map(str::to_owned).collect();
        names.sort();
        names
    }

    pub(crate) fn shape(&self, name: &str) -> Vec<usize> {
        self.tensors.tensor(name).unwrap().shape().to_vec()
    }

    pub(crate) fn floats(&self, name: &str) -> Vec<f32> {
        let tensor = self.tensors.tensor(name).unwrap();
        assert_eq!(tensor.dtype(), Dtype::F32, "{name}");
        tensor.data().as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect()
    }

    pub(crate) fn integers(&self, name: &str) -> Vec<i64> {
        let tensor = self.tensors.tensor(name).unwrap();
        assert_eq!(tensor.dtype(), Dtype::I64, "{name}");
        tensor.data().as_chunks().0.iter().map(|v| i64::from_le_bytes(*v)).collect()
    }
}

/// The largest difference relative to the largest expected value; infinite if one is not finite.
pub(crate) fn error(got: &[f32], want: &[f32]) -> f64 {
    assert_eq!(got.len(), want.len());
    let largest = want.iter().fold(1e-30_f64, |m, &v| m.max(f64::from(v.abs())));
    let difference = got.iter().zip(want).map(|(a, b)| (f64::from(*a) - f64::from(*b)).abs());
    difference.fold(0.0, |worst, d| if d.is_nan() { f64::INFINITY } else { d.max(worst) }) / largest
}

/// Stage, output and model; the four parts count as one output.
type Row = (String, String, String);

/// Largest errors by stage, output and model; `None` for values that must be, and are, identical.
#[derive(Default)]
pub(crate) struct Report(BTreeMap<Row, (usize, Option<f64>)>);

impl Report {
    pub(crate) fn add(&mut self, stage: &str, output: &str, model: &str, error: Option<f64>) {
        let output = output.split('.').next().unwrap_or(output);
        let row = (stage.to_owned(), output.to_owned(), model.to_owned());
        let (tensors, worst) = self.0.entry(row).or_default();
        *tensors += 1;
        *worst = error.map_or(*worst, |error| Some(worst.map_or(error, |worst| worst.max(error))));
    }

    pub(crate) fn has(&self, stage: &str) -> bool {
        self.0.keys().any(|(has, ..)| has == stage)
    }

    pub(crate) fn print(&self, isa: &str) {
        println!("\n{:10} {:12} {:16} {:>7}  largest error ({isa})", "stage", "output", "model", "tensors");
        for ((stage, output, model), (tensors, worst)) in &self.0 {
            let worst = worst.map_or_else(|| "identical".to_owned(), |worst| format!("{worst:.1e}"));
            println!("{stage:10} {output:12} {model:16} {tensors:>7}  {worst}");
        }
    }
}
