use super::*;

/// A folder of files that is removed in the end.
struct Folder(std::path::PathBuf);

impl Folder {
    fn new(name: &str, files: &[(&str, &str)]) -> Self {
        let folder = Self(std::env::temp_dir().join(format!("umo-kinds-{name}-{}", std::process::id())));
        for (path, text) in files {
            let path = folder.0.join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.0));
    }
}

/// Kinds of processors `0..count`, of which file `name` has the value for each.
fn read(name: &str, files: &[(&str, &str)], per_processor: &[(&str, &[u32])], count: usize) -> Cores {
    let mut all: Vec<(String, String)> = files.iter().map(|&(path, text)| (path.into(), format!("{text}\n"))).collect();
    for (file, values) in per_processor {
        for (number, value) in values.iter().enumerate().filter(|&(_, &value)| value > 0) {
            all.push((format!("devices/system/cpu/cpu{number}/{file}"), format!("{value}\n")));
        }
    }
    let all: Vec<_> = all.iter().map(|(path, text)| (&**path, &**text)).collect();
    Cores::read(&Folder::new(name, &all).0, &(0..count).collect::<Vec<_>>())
}

fn short(cores: &Cores) -> Vec<(CoreKind, usize, Vec<usize>)> {
    cores.groups().iter().map(|group| (group.kind, group.cores, group.processors.clone())).collect()
}

const P: CoreKind = CoreKind::Performance;
const E: CoreKind = CoreKind::Efficiency;
const L: CoreKind = CoreKind::LowPower;

#[test]
fn phones_are_grouped_by_capacity() {
    let cores = read("phone", &[], &[("cpu_capacity", &[250, 250, 250, 250, 800, 800, 800, 1024])], 8);
    assert_eq!(short(&cores), [(P, 1, vec![7]), (P, 3, vec![4, 5, 6]), (E, 4, vec![0, 1, 2, 3])]);
    assert_eq!(cores.to_string(), "1 performance (speed 1.00), 3 performance (speed 0.78), 4 efficiency (speed 0.24)");
    // Without capacities, greatest frequencies.
    let cores =
        read("old-phone", &[], &[("cpufreq/cpuinfo_max_freq", &[1_400_000, 1_400_000, 2_400_000, 2_400_000])], 4);
    assert_eq!(short(&cores), [(P, 2, vec![2, 3]), (E, 2, vec![0, 1])]);
    // A measure that some processors lack does not count.
    let cores = read("hole", &[], &[("cpu_capacity", &[512, 0]), ("cpufreq/cpuinfo_max_freq", &[2_000_000; 2])], 2);
    assert_eq!(short(&cores), [(P, 2, vec![0, 1])]);
}

#[test]
fn hybrid_processors_are_grouped_by_kind_whatever_their_frequencies() {
    // Two fast cores with two threads each, of which one may run faster; four small ones; two without the last cache.
    let files = [
        ("devices/cpu_core/cpus", "0-3"),
        ("devices/cpu_atom/cpus", "4-9"),
        ("devices/system/cpu/cpu0/topology/core_cpus_list", "0-1"),
        ("devices/system/cpu/cpu1/topology/core_cpus_list", "0-1"),
        ("devices/system/cpu/cpu2/topology/thread_siblings_list", "2-3"),
        ("devices/system/cpu/cpu3/topology/thread_siblings_list", "2-3"),
    ];
    let frequencies =
        [5_000_000, 5_000_000, 4_200_000, 4_200_000, 3_600_000, 3_600_000, 3_600_000, 3_600_000, 2_500_000, 2_500_000];
    let per = [("cpufreq/cpuinfo_max_freq", &frequencies[..]), ("cache/index3/level", &[3, 3, 3, 3, 3, 3, 3, 3, 0, 0])];
    let cores = read("hybrid", &files, &per, 10);
    assert_eq!(short(&cores), [(P, 2, vec![0, 1, 2, 3]), (E, 4, vec![4, 5, 6, 7]), (L, 2, vec![8, 9])]);
    // Cores that the process may not use do not count: here it has only small ones.
    let folder = Folder::new("confined", &[("devices/cpu_core/cpus", "0-1\n"), ("devices/cpu_atom/cpus", "2-3\n")]);
    assert!(!Cores::read(&folder.0, &[2, 3]).differ());
    assert_eq!(short(&Cores::read(&folder.0, &[1, 2])), [(P, 1, vec![1]), (E, 1, vec![2])]);
    // A list of its own names the low-power cores.
    let lists = [("devices/cpu_core/cpus", "0"), ("devices/cpu_atom/cpus", "1"), ("devices/cpu_lowpower/cpus", "2,")];
    assert_eq!(short(&read("lists", &lists, &[], 3)), [(P, 1, vec![0]), (E, 1, vec![1]), (L, 1, vec![2])]);
    // By the text of each processor.
    let types = [
        ("devices/system/cpu/cpu0/topology/core_type", "efficiency"),
        ("devices/system/cpu/cpu1/topology/core_type", "performance"),
    ];
    assert_eq!(short(&read("types", &types, &[], 2)), [(P, 1, vec![1]), (E, 1, vec![0])]);
}

#[test]
fn favoured_cores_and_machines_that_say_nothing_are_of_one_kind() {
    let cores = read("favoured", &[], &[("acpi_cppc/highest_perf", &[196, 191, 186, 181])], 4);
    assert_eq!(short(&cores), [(P, 4, vec![0, 1, 2, 3])]);
    assert_eq!(cores.to_string(), "one kind");
    assert_eq!(short(&read("nothing", &[], &[], 3)), [(P, 3, vec![0, 1, 2])]);
    assert!(read("no-processor", &[], &[], 0).groups().is_empty());
    // Dense cores of half the frequency are efficiency cores.
    let cores = read("dense", &[], &[("acpi_cppc/highest_perf", &[200, 200, 125, 125])], 4);
    assert_eq!(short(&cores), [(P, 2, vec![0, 1]), (E, 2, vec![2, 3])]);
}

/// Bytes of one entry of Windows' array.
fn set(id: u32, core: u8, class: u8) -> Vec<u8> {
    let mut bytes = vec![0; 32];
    bytes[0] = 32;
    bytes[8..12].copy_from_slice(&id.to_le_bytes());
    (bytes[14], bytes[15], bytes[18]) = (u8::try_from(id).unwrap(), core, class);
    bytes
}

#[test]
fn windows_sets_are_grouped_by_class() {
    let sets = [set(256 - 1, 0, 1), set(200, 0, 1), set(201, 2, 0), set(202, 3, 0)].concat();
    let cores = Cores::of_cpu_sets(&sets);
    assert_eq!(short(&cores), [(P, 1, vec![200, 255]), (E, 2, vec![201, 202])]);
    // One class, as some Arm processors with two kinds report it: left to the system.
    assert!(!Cores::of_cpu_sets(&[set(1, 0, 0), set(2, 1, 0)].concat()).differ());
    let three = Cores::of_cpu_sets(&[set(1, 0, 0), set(2, 1, 5), set(3, 2, 9)].concat());
    assert_eq!(short(&three), [(P, 1, vec![3]), (E, 1, vec![2]), (L, 1, vec![1])]);
    // Other types are skipped, and incomplete entries are not read.
    let mut other = set(7, 7, 3);
    other[4] = 1;
    let cut = [other, set(1, 0, 0), set(2, 1, 1)[..20].to_vec()].concat();
    assert_eq!(short(&Cores::of_cpu_sets(&cut)), [(P, 1, vec![1])]);
    assert!(Cores::of_cpu_sets(&[0; 64]).groups().is_empty());
}

#[test]
fn apples_levels_have_cores_and_no_numbers() {
    let cores = Cores::of_levels(&[4, 6]);
    assert_eq!(short(&cores), [(P, 4, vec![]), (E, 6, vec![])]);
    assert!(!Cores::of_levels(&[4]).differ() && Cores::of_levels(&[]).groups().is_empty());
}

#[test]
fn the_fastest_kind_is_that_of_all_its_threads_together() {
    let phone = read("fastest", &[], &[("cpu_capacity", &[250, 250, 250, 250, 800, 800, 800, 1024])], 8);
    let cores = |threads| phone.fastest(threads).map(|group| (group.cores, group.speed > 0.9));
    assert_eq!((cores(1), cores(2), cores(8)), (Some((1, true)), Some((3, false)), Some((3, false))));
    assert_eq!(phone.slowest().map(|group| group.cores), Some(4));
    // Few fast cores, many small ones.
    let lists =
        [("devices/cpu_core/cpus", "0-1"), ("devices/cpu_atom/cpus", "2-9"), ("devices/cpu_lowpower/cpus", "10-30")];
    let laptop = read("laptop", &lists, &[], 31);
    let kind = |threads| laptop.fastest(threads).map(|group| group.kind);
    assert_eq!((kind(2), kind(4), kind(20)), (Some(P), Some(E), Some(E)));
    assert_eq!(laptop.slowest().map(|group| group.kind), Some(E));
    let server = read("server", &[], &[("cpu_capacity", &[1024; 4])], 4);
    assert!(server.fastest(4).is_none() && server.slowest().is_none());
}
