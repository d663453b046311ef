//! Shared parts of the benches and measurements: random numbers, models, and the processor's
//! peak rates.

pub mod parts;

use std::path::Path;

use umo_core::ModelFile;
use umo_core_tools::floor::Machine;
use umo_kernels::Isa;

/// Memory over which the bandwidth is measured: the size of the decoder's weights.
pub const READ_BYTES: usize = 384 << 20;

/// Numbers from a counter: SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Debug)]
pub struct Random(u64);

impl Random {
    /// Makes an independent stream of numbers for every seed.
    pub fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0xA076_1D64_78BD_642F))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// A number below `limit`, which is far below 2^64.
    #[expect(clippy::cast_possible_truncation, reason = "below a `usize`")]
    pub fn below(&mut self, limit: usize) -> usize {
        (self.bits() % limit as u64) as usize
    }

    /// A number in -1..1.
    #[expect(clippy::cast_precision_loss, reason = "24 bits fit an f32")]
    pub fn unit(&mut self) -> f32 {
        (self.bits() >> 40) as f32 / (1_u32 << 23) as f32 - 1.0
    }

    /// A normally distributed number with variance 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f32 {
        let (radius, angle) = (self.unit().abs().max(f32::MIN_POSITIVE), self.unit());
        (-2.0 * radius.ln()).sqrt() * (std::f32::consts::PI * angle).cos()
    }

    /// Any int8.
    pub fn int8(&mut self) -> i8 {
        self.bits().to_le_bytes()[0].cast_signed()
    }
}

/// Whether the benches run once as tests: `cargo bench -- --test`.
pub fn is_test() -> bool {
    std::env::args().any(|arg| arg == "--test")
}

/// The back-end that `UMO_ISA` names, or the fastest.
pub fn isa() -> Isa {
    let Ok(name) = std::env::var("UMO_ISA") else { return Isa::detect() };
    Isa::from_name(&name).unwrap_or_else(|| panic!("UMO_ISA: this processor does not have {name}"))
}

/// Peak rates of the processor with this many threads, each of which reads `cache_bytes` repeatedly; `None` if
/// benches run as tests.
pub fn machine(threads: usize, cache_bytes: usize) -> Option<Machine> {
    (!is_test()).then(|| Machine::measure(threads, isa(), READ_BYTES, cache_bytes))
}

/// The model of layout `parts` at `UMO_BENCH_MODEL`, or a random one with int8 weights: of base size,
/// or small if benches run as tests.
pub fn model() -> ModelFile {
    open("UMO_BENCH_MODEL", "parts", "bench-base-int8.safetensors")
}

/// The same for layout `frames`, at `UMO_BENCH_FRAMES`.
pub fn frames_model() -> ModelFile {
    open("UMO_BENCH_FRAMES", "frames", "bench-base-frames-int8.safetensors")
}

fn open(variable: &str, layout: &str, name: &str) -> ModelFile {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    if let Some(path) = std::env::var_os(variable) {
        // Cargo runs benches in their package's folder; paths on its command line are relative to the repository.
        return ModelFile::open(&root.join(path)).unwrap_or_else(|error| panic!("{variable}: {error}"));
    }
    if is_test() {
        let folder = tempfile::tempdir().expect("a folder for temporary files");
        let path = folder.path().join("small.safetensors");
        make("small", layout, &path);
        let bytes = std::fs::read(path).expect("it was just written");
        return ModelFile::from_bytes(bytes).expect("it was just written");
    }
    let path = root.join("target").join(name);
    if !path.exists() {
        make("base", layout, &path);
    }
    ModelFile::open(&path).unwrap_or_else(|error| panic!("{error}"))
}

/// Writes a random model: bf16, then its products in int8 as `umo model quantize` chooses.
fn make(size: &str, layout: &str, path: &Path) {
    let float = path.with_extension("float");
    let run = |args: &[&std::ffi::OsStr]| {
        let args = std::iter::once("umo".as_ref()).chain(args.iter().copied()).map(Into::into);
        let code = umo_cli::main(args);
        assert_eq!(format!("{code:?}"), format!("{:?}", std::process::ExitCode::SUCCESS), "no model was made");
    };
    let random = ["model", "random", "--size", size, "--layout", layout, "-o"].map(AsRef::as_ref);
    run(&[&random[..], &[float.as_ref()]].concat());
    run(&[
        "model".as_ref(),
        "quantize".as_ref(),
        float.as_ref(),
        "--weights".as_ref(),
        "int8".as_ref(),
        "-o".as_ref(),
        path.as_ref(),
    ]);
    std::fs::remove_file(float).expect("it was just written");
}
