//! Takes model files apart, changes them, and reassembles them, valid or invalid.

use std::collections::BTreeMap;
use std::path::Path;

use safetensors::SafeTensors;
use serde_json::{Map, Value, json};

/// One stored tensor.
#[derive(Clone, Debug)]
pub(crate) struct Stored {
    pub(crate) dtype: String,
    pub(crate) shape: Vec<usize>,
    pub(crate) bytes: Vec<u8>,
}

/// A model file in pieces.
#[derive(Clone, Debug)]
pub(crate) struct ModelBytes {
    pub(crate) metadata: BTreeMap<String, String>,
    pub(crate) config: Value,
    pub(crate) tensors: BTreeMap<String, Stored>,
}

impl ModelBytes {
    /// A golden model.
    pub(crate) fn open(name: &str) -> Self {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("golden").join(name).join("model.safetensors");
        let bytes = std::fs::read(path).unwrap();
        let (_, header) = SafeTensors::read_metadata(&bytes).unwrap();
        let mut metadata: BTreeMap<_, _> =
            header.metadata().clone().expect("models have metadata").into_iter().collect();
        let config = serde_json::from_str(&metadata.remove("config").unwrap()).unwrap();
        let stored = |(name, view): (String, safetensors::tensor::TensorView)| {
            let dtype = view.dtype().to_string();
            (name, Stored { dtype, shape: view.shape().to_vec(), bytes: view.data().to_vec() })
        };
        let tensors = SafeTensors::deserialize(&bytes).unwrap().tensors().into_iter().map(stored).collect();
        Self { metadata, config, tensors }
    }

    /// The header as JSON, with tensors contiguous in the order of their names.
    pub(crate) fn header(&self) -> Map<String, Value> {
        let mut metadata = self.metadata.clone();
        metadata.insert("config".to_owned(), self.config.to_string());
        let (mut header, mut end) = (Map::new(), 0);
        header.insert("__metadata__".to_owned(), json!(metadata));
        for (name, Stored { dtype, shape, bytes }) in &self.tensors {
            let entry = json!({ "dtype": dtype, "shape": shape, "data_offsets": [end, end + bytes.len()] });
            header.insert(name.clone(), entry);
            end += bytes.len();
        }
        header
    }

    /// The tensors' bytes.
    pub(crate) fn data(&self) -> Vec<u8> {
        let all: Vec<&[u8]> = self.tensors.values().map(|stored| &stored.bytes[..]).collect();
        all.concat()
    }

    /// The file.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        file(&Value::Object(self.header()).to_string(), &self.data())
    }
}

/// A file with this header and data.
pub(crate) fn file(header: &str, data: &[u8]) -> Vec<u8> {
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), data].concat()
}
