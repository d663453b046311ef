//! Kinds of cores: which processors are fast, which save energy, and how many cores there are of each.
//!
//! | system | source |
//! |---|---|
//! | Linux, Android | folder `/sys`: `cpu_core`, `cpu_atom` and `cpu_lowpower`, `core_type`, `cpu_capacity`, the greatest performance or frequency |
//! | Windows | efficiency classes of the CPU sets |
//! | macOS, iOS | `hw.perflevelN` |

use std::fmt;

#[cfg(feature = "threads")]
use std::path::Path;

/// Speed, relative to the first core of a group, below which a core belongs to another one: cores that are let run a
/// little faster than their like stay with them.
const SAME_SPEED: f32 = 0.85;
/// Speed, relative to the fastest core, from which a core of unknown kind counts as a performance core.
const PERFORMANCE: f32 = 0.7;
/// Speed, relative to the group before it, below which a second kind of efficiency core counts as low-power.
const LOW_POWER: f32 = 0.6;
/// Speeds of the kinds where the system reports none.
const TYPICAL: [f32; 3] = [1.0, 0.6, 0.4];

/// Kind of a core.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum CoreKind {
    /// Fast.
    Performance,
    /// Slower, for less energy.
    Efficiency,
    /// The slowest of three kinds.
    LowPower,
}

impl CoreKind {
    /// From the fastest kind to the slowest.
    const ALL: [Self; 3] = [Self::Performance, Self::Efficiency, Self::LowPower];
}

impl fmt::Display for CoreKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Performance => "performance",
            Self::Efficiency => "efficiency",
            Self::LowPower => "low-power",
        })
    }
}

/// Cores of one kind and speed.
#[derive(Clone, Debug, PartialEq)]
pub struct CoreGroup {
    /// Their kind.
    pub kind: CoreKind,
    /// Speed of the slowest of them relative to the machine's fastest core, 0 to 1; a typical one where the system reports
    /// none.
    pub speed: f32,
    /// Number of cores; hardware threads that share a core count once.
    pub cores: usize,
    /// Their hardware threads, by the system's numbers, ascending; on Windows ids of CPU sets. Empty on Apple's systems,
    /// which bind no threads.
    pub processors: Vec<usize>,
}

impl CoreGroup {
    /// Keeps the calling thread on these cores, if the system allows it; returns whether it does. Never allocates.
    #[doc(hidden)]
    pub fn keep(&self) -> bool {
        super::cores::prefer(self)
    }
}

/// The machine's cores by kind, the fastest first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cores(Vec<CoreGroup>);

/// One hardware thread, as a system reports it.
#[derive(Clone, Debug)]
struct Processor {
    number: usize,
    /// Equal for hardware threads of one core.
    core: String,
    kind: Option<CoreKind>,
    speed: Option<f32>,
}

impl Cores {
    /// Cores of one kind, or of unknown ones: threads run where the system puts them.
    pub fn unknown() -> Self {
        Self::default()
    }

    /// The cores that this process may use.
    pub fn system() -> Self {
        super::cores::kinds()
    }

    /// The groups, the fastest first; empty if the system does not report them.
    pub fn groups(&self) -> &[CoreGroup] {
        &self.0
    }

    /// Whether there are several kinds or speeds.
    pub fn differ(&self) -> bool {
        self.0.len() > 1
    }

    /// The group that computes fastest with at most `threads` threads, one for each of its cores; no low-power one. `None` if
    /// the cores do not differ.
    pub fn fastest(&self, threads: usize) -> Option<&CoreGroup> {
        let speed = |group: &CoreGroup| threads.min(group.cores) as f32 * group.speed;
        let usual = self.0.iter().filter(|group| group.kind != CoreKind::LowPower);
        let best = usual.reduce(|best, group| if speed(group) > speed(best) { group } else { best });
        best.filter(|_| self.differ())
    }

    /// The slowest group that is not low-power; `None` if the cores do not differ.
    pub fn slowest(&self) -> Option<&CoreGroup> {
        self.0.iter().rfind(|group| group.kind != CoreKind::LowPower && self.differ())
    }

    /// Groups hardware threads by their kind if that is reported for all, or else by their speed.
    fn grouped(mut all: Vec<Processor>) -> Self {
        let fastest = all.iter().filter_map(|one| one.speed).fold(0.0, f32::max);
        let has_speeds = fastest > 0.0 && all.iter().all(|one| one.speed.is_some_and(|speed| speed > 0.0));
        let has_kinds = all.iter().all(|one| one.kind.is_some());
        let speed = |one: &Processor| match (one.speed, one.kind) {
            (Some(speed), _) if has_speeds => speed / fastest,
            (_, Some(kind)) => TYPICAL[kind as usize],
            _ => 1.0,
        };
        // The fastest first, and the numbers of a group ascend.
        all.sort_by(|a, b| {
            let kinds = if has_kinds { a.kind.cmp(&b.kind) } else { std::cmp::Ordering::Equal };
            kinds.then(speed(b).total_cmp(&speed(a))).then(a.number.cmp(&b.number))
        });
        let mut groups: Vec<(CoreGroup, Vec<&str>, f32)> = Vec::new();
        for one in &all {
            let speed = speed(one);
            let is_same = |(group, _, first): &(CoreGroup, Vec<&str>, f32)| match one.kind {
                Some(kind) if has_kinds => kind == group.kind,
                _ => speed >= SAME_SPEED * first,
            };
            if !groups.last().is_some_and(is_same) {
                let kind = one.kind.filter(|_| has_kinds).unwrap_or(CoreKind::Performance);
                groups.push((CoreGroup { kind, speed, cores: 0, processors: Vec::new() }, Vec::new(), speed));
            }
            let Some((group, cores, _)) = groups.last_mut() else { continue };
            group.speed = group.speed.min(speed);
            group.processors.push(one.number);
            if !cores.contains(&&*one.core) {
                cores.push(&one.core);
            }
        }
        let mut groups: Vec<_> =
            groups.into_iter().map(|(group, cores, _)| CoreGroup { cores: cores.len(), ..group }).collect();
        let mut slower: Option<f32> = None;
        for group in &mut groups {
            group.processors.sort_unstable();
            if !has_kinds && group.speed < PERFORMANCE {
                let is_low = slower.is_some_and(|slower| group.speed < LOW_POWER * slower);
                group.kind = if is_low { CoreKind::LowPower } else { CoreKind::Efficiency };
                slower = Some(group.speed);
            }
        }
        Self(groups)
    }

    /// [`Self::system`], or what a folder in place of Linux's `/sys` says.
    #[cfg(feature = "threads")]
    #[doc(hidden)]
    pub fn system_at(root: &Path) -> Self {
        if root == Path::new("/sys") { Self::system() } else { Self::read(root, &super::cores::usable()) }
    }

    /// Reads the kinds of the `usable` processors from a folder such as `/sys`.
    #[cfg(feature = "threads")]
    #[doc(hidden)]
    pub fn read(root: &Path, usable: &[usize]) -> Self {
        let text = |path: &str| std::fs::read_to_string(root.join(path)).ok().map(|text| text.trim().to_owned());
        let lists = [CoreKind::Performance, CoreKind::Efficiency, CoreKind::LowPower].into_iter().zip([
            "devices/cpu_core/cpus",
            "devices/cpu_atom/cpus",
            "devices/cpu_lowpower/cpus",
        ]);
        let lists: Vec<(CoreKind, Vec<usize>)> =
            lists.filter_map(|(kind, path)| Some((kind, numbers(&text(path)?)))).collect();
        let of = |number: usize, file: &str| text(&format!("devices/system/cpu/cpu{number}/{file}"));
        // The first measure that every processor has; a frequency says least.
        let measures = ["cpu_capacity", "acpi_cppc/highest_perf", "cpufreq/cpuinfo_max_freq"];
        let speed =
            |number: usize, measure: &str| of(number, measure)?.parse::<f32>().ok().filter(|&speed| speed > 0.0);
        let measure =
            measures.into_iter().find(|measure| usable.iter().all(|&number| speed(number, measure).is_some()));
        let last_cache = |number: usize| of(number, "cache/index3/level").is_some();
        let has_last_cache = !lists.is_empty() && usable.iter().any(|&number| last_cache(number));
        let processors = usable.iter().map(|&number| {
            let listed = lists.iter().rev().find(|(_, list)| list.contains(&number)).map(|&(kind, _)| kind);
            let typed = || of(number, "topology/core_type").and_then(|text| kind_of(&text));
            let kind = listed.or_else(typed).map(|kind| match kind {
                // The cores of an Intel processor's other chiplet have no share of the last cache.
                CoreKind::Efficiency if has_last_cache && !last_cache(number) => CoreKind::LowPower,
                kind => kind,
            });
            let core = of(number, "topology/core_cpus_list").or_else(|| of(number, "topology/thread_siblings_list"));
            Processor {
                number,
                core: core.unwrap_or_else(|| number.to_string()),
                kind,
                speed: measure.and_then(|measure| speed(number, measure)),
            }
        });
        Self::grouped(processors.collect())
    }

    /// Reads the array that Windows' `GetSystemCpuSetInformation` writes: entries that begin with their size, of which the
    /// type 0 are CPU sets. A greater efficiency class is faster.
    #[doc(hidden)]
    pub fn of_cpu_sets(mut bytes: &[u8]) -> Self {
        const ENTRY: usize = 24;
        let mut sets = Vec::new();
        while let Some(&[a, b, c, d]) = bytes.first_chunk::<4>() {
            let size = u32::from_le_bytes([a, b, c, d]) as usize;
            let Some(entry) = bytes.get(..size).filter(|_| size >= ENTRY) else { break };
            bytes = &bytes[size..];
            if entry[4..8] == [0; 4] {
                let id = u32::from_le_bytes([entry[8], entry[9], entry[10], entry[11]]) as usize;
                let core = format!("{}:{}:{}", entry[12], entry[13], entry[15]);
                sets.push((entry[18], id, core));
            }
        }
        let mut classes: Vec<u8> = sets.iter().map(|&(class, ..)| class).collect();
        classes.sort_unstable_by(|a, b| b.cmp(a));
        classes.dedup();
        let kind = |class| {
            let rank = classes.iter().position(|&known| known == class).unwrap_or_default();
            CoreKind::ALL.get(rank).copied().or(Some(CoreKind::LowPower))
        };
        let processor = |(class, number, core)| Processor { number, core, kind: kind(class), speed: None };
        Self::grouped(sets.into_iter().map(processor).collect())
    }

    /// Kinds from the numbers of cores of Apple's performance levels, the fastest first.
    #[doc(hidden)]
    pub fn of_levels(levels: &[usize]) -> Self {
        let kinds = CoreKind::ALL.into_iter().zip(TYPICAL).zip(levels).filter(|&(_, &cores)| cores > 0);
        Self(kinds.map(|((kind, speed), &cores)| CoreGroup { kind, speed, cores, processors: Vec::new() }).collect())
    }
}

impl fmt::Display for Cores {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.len() < 2 {
            return f.write_str(if self.0.is_empty() { "unknown kinds" } else { "one kind" });
        }
        for (i, CoreGroup { kind, speed, cores, .. }) in self.0.iter().enumerate() {
            let comma = if i > 0 { ", " } else { "" };
            write!(f, "{comma}{cores} {kind} (speed {speed:.2})")?;
        }
        Ok(())
    }
}

/// Kind by the text of `core_type`.
#[cfg(feature = "threads")]
fn kind_of(text: &str) -> Option<CoreKind> {
    let text = text.to_ascii_lowercase();
    let has = |words: &[&str]| words.iter().any(|word| text.contains(word));
    match () {
        () if has(&["low"]) => Some(CoreKind::LowPower),
        () if has(&["atom", "efficien"]) => Some(CoreKind::Efficiency),
        () if has(&["core", "perf"]) => Some(CoreKind::Performance),
        () => None,
    }
}

/// Numbers of a list such as `0-3,8`.
#[cfg(feature = "threads")]
fn numbers(list: &str) -> Vec<usize> {
    const MOST: usize = 1 << 16;
    let range = |part: &str| {
        let (from, to) = part.split_once('-').unwrap_or((part, part));
        let (from, to) = (from.trim().parse().ok()?, to.trim().parse::<usize>().ok()?.min(MOST));
        Some(from..=to)
    };
    list.split(',').filter_map(range).flatten().collect()
}

#[cfg(all(test, feature = "threads"))]
mod tests;
