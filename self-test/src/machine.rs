//! The machine: processor, instruction sets, cores.

use umo_core_base::team::Cores;
use umo_core_base::thread;
use umo_kernels::Isa;

/// Properties of the machine, without host name, user name or path.
#[derive(Clone, Debug)]
pub struct Machine {
    /// The vendor's name, or the architecture.
    pub processor: String,
    /// Number of hardware threads.
    pub threads: usize,
    /// Kinds of cores, if the system reports them.
    pub cores: Option<String>,
    /// Features that the back-ends can use.
    pub features: Vec<&'static str>,
}

impl Machine {
    /// Properties of this machine.
    pub fn this() -> Self {
        let known = Some(Cores::system()).filter(|cores| !cores.groups().is_empty()).map(|cores| cores.to_string());
        let cores = known.or_else(|| is_hybrid().then(|| "more than one kind".to_owned()));
        Self { processor: processor(), threads: thread::available(), cores, features: features() }
    }
}

/// Reason why the kernels run on `isa`.
pub fn reason(isa: Isa) -> String {
    let missing: Vec<_> = Isa::names().filter(|name| Isa::from_name(name).is_none()).collect();
    let why = match isa == Isa::detect() {
        true => "the fastest that this processor and system have".to_owned(),
        false => format!("as was asked; {} is faster", Isa::detect().name()),
    };
    if missing.is_empty() { why } else { format!("{why}; not here: {}", missing.join(", ")) }
}

/// Suggests changes that would make umo faster on this machine.
pub fn advice(isa: Isa, machine: &Machine) -> Vec<String> {
    let mut advice = vec![];
    if cfg!(debug_assertions) {
        advice.push("this build checks itself (debug assertions): build with --release".to_owned());
    }
    if isa != Isa::detect() {
        advice.push(format!("the model was loaded for {}: load it for {}", isa.name(), Isa::detect().name()));
    }
    match isa.name() {
        "scalar" => advice.push("no vector back-end: every product runs one number at a time".to_owned()),
        "avx2" => {
            advice.push("no int8 dot products (VNNI): a newer processor is two to three times as fast".to_owned())
        }
        "neon" => advice.push("no int8 dot products: an Armv8.2 processor or newer is faster".to_owned()),
        _ => {}
    }
    if cfg!(feature = "threads") && machine.threads == 1 {
        advice.push("one thread: give the process more cores".to_owned());
    }
    if let Some(mode) = power_mode() {
        advice.push(format!("the power mode is `{mode}`: choose `performance` while avatars speak"));
    }
    advice
}

#[cfg(target_arch = "x86_64")]
fn processor() -> String {
    use std::arch::x86_64::__cpuid;

    /// The last of the three CPUID leaves that hold the name.
    const NAME_END: u32 = 0x8000_0004;
    let mut name = String::new();
    if __cpuid(0x8000_0000).eax >= NAME_END {
        let bytes: Vec<u8> = (NAME_END - 2..=NAME_END)
            .map(__cpuid)
            .flat_map(|leaf| [leaf.eax, leaf.ebx, leaf.ecx, leaf.edx])
            .flat_map(u32::to_le_bytes)
            .take_while(|byte| *byte != 0)
            .collect();
        name = String::from_utf8_lossy(&bytes).split_whitespace().collect::<Vec<_>>().join(" ");
    }
    let signature = __cpuid(1).eax;
    let family = (signature >> 8 & 0xf) + (signature >> 20 & 0xff);
    let model = (signature >> 4 & 0xf) | (signature >> 12 & 0xf0);
    if name.is_empty() {
        name = "x86-64".to_owned();
    }
    format!("{name}, family {family:#x}, model {model:#x}")
}

/// Names the cores by their vendors' part numbers, if Linux reports them.
#[cfg(not(target_arch = "x86_64"))]
fn processor() -> String {
    let text = read("/proc/cpuinfo").unwrap_or_default();
    let value =
        |line: &str, key: &str| line.strip_prefix(key)?.split_once(':').map(|(_, value)| value.trim().to_owned());
    let (mut maker, mut parts) = (None, vec![]);
    for line in text.lines() {
        maker = maker.or_else(|| value(line, "CPU implementer"));
        parts.extend(value(line, "CPU part"));
    }
    parts.sort();
    parts.dedup();
    match maker {
        Some(maker) => format!("{}, implementer {maker}, part {}", std::env::consts::ARCH, parts.join(" and ")),
        None => std::env::consts::ARCH.to_owned(),
    }
}

#[cfg(target_arch = "x86_64")]
fn features() -> Vec<&'static str> {
    macro_rules! found {
        ($($name:tt)+) => {
            [$(($name, std::arch::is_x86_feature_detected!($name))),+]
        };
    }
    let all =
        found!("avx2" "fma" "f16c" "avxvnni" "avx512f" "avx512bw" "avx512dq" "avx512vl" "avx512vnni" "avx512bf16");
    all.into_iter().filter_map(|(name, is_there)| is_there.then_some(name)).collect()
}

#[cfg(target_arch = "aarch64")]
fn features() -> Vec<&'static str> {
    macro_rules! found {
        ($($name:tt)+) => {
            [$(($name, std::arch::is_aarch64_feature_detected!($name))),+]
        };
    }
    let all = found!("neon" "fp16" "dotprod" "i8mm" "bf16" "sve" "sve2");
    all.into_iter().filter_map(|(name, is_there)| is_there.then_some(name)).collect()
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn features() -> Vec<&'static str> {
    Vec::new()
}

/// Whether an Intel processor reports two kinds of cores.
fn is_hybrid() -> bool {
    #[cfg(target_arch = "x86_64")]
    return std::arch::x86_64::__cpuid(0).eax >= 7 && std::arch::x86_64::__cpuid_count(7, 0).edx >> 15 & 1 == 1;
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// The power mode of Linux, if it limits the processor's speed.
fn power_mode() -> Option<String> {
    let mode = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")?.trim().to_owned();
    // The `powersave` mode of Intel's driver reaches full speed.
    let driver = read("/sys/devices/system/cpu/cpu0/cpufreq/scaling_driver").unwrap_or_default();
    (mode == "powersave" && !driver.trim().ends_with("pstate") && !driver.trim().ends_with("epp")).then_some(mode)
}

/// Reads a system file, if it exists.
#[cfg(feature = "files")]
fn read(path: &str) -> Option<String> {
    std::fs::read_to_string(path).ok()
}

#[cfg(not(feature = "files"))]
fn read(_path: &str) -> Option<String> {
    None
}
