//! `umo bench` and `umo doctor`: refusals and output.

use crate::program::{Folder, golden, umo};

const QUICK: [&str; 7] = ["bench", "--chunks", "3", "--starts", "2", "--seconds", "0.3"];

#[test]
fn bench_writes_json_with_every_stage_beside_its_floor_and_a_picture() {
    let folder = Folder::new();
    let picture = folder.at("bench.svg");
    let args = [&QUICK[..], &["--sessions", "2", "--threads", "1", "--priority", "low", "--json", "--plot", &picture]]
        .concat();
    let ended = umo(&args).success();
    assert_eq!(ended.out.lines().count(), 1);
    let report: serde_json::Value = serde_json::from_str(&ended.out).unwrap();
    let number = |value: &serde_json::Value| value.as_f64().unwrap_or_else(|| panic!("no number: {value}"));
    assert_eq!(report["threads"], 1);
    assert_eq!((number(&report["first_frame_ms"]["count"]), number(&report["chunk_ms"]["count"])), (2.0, 3.0));
    for key in ["first_frame_ms", "chunk_ms"] {
        let [p50, p99, max] = ["p50", "p99", "max"].map(|which| number(&report[key][which]));
        assert!(0.0 < p50 && p50 <= p99 && p99 <= max, "{key}: {p50}, {p99}, {max}");
    }
    let times = report["chunk_ms"]["times"].as_array().unwrap();
    let longest = times.iter().map(number).fold(0.0, f64::max);
    assert_eq!((times.len(), longest), (3, number(&report["chunk_ms"]["max"])));
    assert!(number(&report["frames_per_second"]) > 0.0);
    assert!(number(&report["peaks"]["read_gb_per_s"]) > 0.0);
    let stages = report["stages"].as_array().unwrap();
    let names: Vec<_> = stages.iter().map(|stage| stage["stage"].as_str().unwrap()).collect();
    let tokenizer_to_motion = [
        "audio tokenizer",
        "encoder attention",
        "encoder experts",
        "decoder attention",
        "decoder experts",
        "depth network",
        "interpolation",
        "motion decoders",
    ];
    assert_eq!(names, tokenizer_to_motion);
    for stage in stages {
        assert!(number(&stage["ms"]) > 0.0 && number(&stage["floor_ms"]) >= 0.0, "{stage}");
    }
    assert_eq!((&report["busy_machine"], &report["priority"]), (&false.into(), &"low".into()));
    if cfg!(target_os = "linux") {
        assert!(number(&report["processor_ms_per_chunk"]) >= 0.0);
    }
    let crowd = &report["real_time"];
    assert_eq!((number(&crowd["sessions"]), number(&crowd["overruns"])), (2.0, 0.0));
    assert!((0.0..=1.0).contains(&number(&crowd["busy"])) && number(&crowd["sessions_at_full_load"]) >= 2.0);
    let svg = std::fs::read_to_string(&picture).unwrap();
    assert_eq!(folder.names(), ["bench.svg"]);
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>") && svg.contains("3 chunks"));
}

#[test]
fn bench_prints_a_table_for_people() {
    let ended = umo(&[&QUICK[..], &["--target", "2", "--isa", "scalar"]].concat()).success();
    let of = |name: &str| -> Vec<f64> {
        let line = ended.out.lines().find_map(|line| line.strip_prefix(name));
        let line = line.unwrap_or_else(|| panic!("no line `{name}` in {}", ended.out));
        line.split_whitespace().filter_map(|word| word.parse().ok()).collect()
    };
    let (first, rate, chunk) = (of("time to the first frame")[0], of("frames per second")[0], of("a chunk")[0]);
    // Two keyframes per chunk; both numbers are printed to a tenth.
    assert!(first > 0.0 && chunk > 0.0 && rate > 0.0, "{}", ended.out);
    // Milliseconds, share, floor and floor divided by time, of each stage and of the total.
    let stages = ["audio tokenizer", "encoder attention", "encoder experts", "decoder attention", "decoder experts"];
    let stages = stages.into_iter().chain(["depth network", "interpolation", "motion decoders"]).map(of);
    let sums = stages.fold([0.0; 3], |sums, stage| std::array::from_fn(|i| sums[i] + stage[i]));
    let all = of("all ");
    assert!((sums[0] - all[0]).abs() < 0.1 && (sums[1] - 100.0).abs() < 0.5, "{}", ended.out);
    assert!((sums[2] - all[1]).abs() < 0.1, "{}", ended.out);
    assert!(ended.out.contains("peaks of") && ended.out.contains("with scalar: int8 unknown"), "{}", ended.out);
    assert!(ended.out.contains("could speak"), "{}", ended.out);
}

/// The first frame comes with the second chunk.
#[test]
fn bench_measures_chunks_of_one_keyframe() {
    let ended = umo(&["bench", "--chunks", "3", "--starts", "2", "--seconds", "0", "--target", "1"]).success();
    assert!(ended.out.contains("1 keyframe a chunk") && ended.out.contains("a chunk "), "{}", ended.out);
}

#[test]
fn bench_measures_beside_other_programs() {
    let ended = umo(&[&QUICK[..], &["--busy"]].concat()).success();
    assert!(ended.out.contains("beside a program on every core"), "{}", ended.out);
    assert!(ended.out.contains("could speak"), "{}", ended.out);
}

/// A machine with a fast and a slow core, in place of this one.
#[cfg(target_os = "linux")]
#[test]
fn bench_shows_the_kinds_of_cores_and_which_it_uses() {
    let folder = Folder::new();
    for (core, capacity) in [(0, "1024"), (1, "512")] {
        let cpu = folder.at(&format!("devices/system/cpu/cpu{core}"));
        std::fs::create_dir_all(&cpu).unwrap();
        std::fs::write(format!("{cpu}/cpu_capacity"), capacity).unwrap();
    }
    let sys = folder.at("");
    if std::thread::available_parallelism().map_or(1, usize::from) != 2 {
        return;
    }
    let ended = umo(&[&QUICK[..], &["--sys", &sys]].concat()).success();
    let wanted = "cores: 1 performance (speed 1.00), 1 efficiency (speed 0.50); threads on performance cores, \
                  a lone avatar on a core of efficiency";
    assert!(ended.out.contains(wanted), "{}", ended.out);
    assert!(ended.out.contains(", 1 thread"), "one thread per core of the kind: {}", ended.out);
    let ended = umo(&[&QUICK[..], &["--sys", &sys, "--cores", "efficiency", "--json"]].concat()).success();
    let report: serde_json::Value = serde_json::from_str(&ended.out).unwrap();
    assert_eq!((&report["cores"]["threads_on"], &report["threads"]), (&"efficiency".into(), &1.into()));
    assert_eq!(report["cores"]["kinds"].as_array().map(Vec::len), Some(2));
    let ended = umo(&[&QUICK[..], &["--sys", &sys, "--cores", "system"]].concat()).success();
    assert!(!ended.out.contains("threads on") && ended.out.contains(", 2 threads"), "{}", ended.out);
}

/// Counters that stand still, in place of this machine's.
#[test]
fn bench_says_what_a_second_of_an_avatar_costs() {
    let folder = Folder::new();
    let zone = folder.at("class/powercap/intel-rapl:0");
    std::fs::create_dir_all(&zone).unwrap();
    for (name, text) in [("name", "package-0"), ("energy_uj", "7000000"), ("max_energy_range_uj", "9000000")] {
        std::fs::write(format!("{zone}/{name}"), text).unwrap();
    }
    let sys = folder.at("");
    let int4 = golden("frames_one");
    let args = ["bench", "--energy", "--seconds", "0.2", "--sessions", "2", "--sys", &sys, "--int4", &int4];
    let ended = umo(&args).success();
    let rows = ["one avatar, 1 thread", "one avatar, 2 threads", "2 avatars, 1 thread", "2 avatars, 2 threads"];
    for row in rows.into_iter().chain(["one avatar, int4", "one, held body", "one, mouth alone", "2, mouths alone"]) {
        let line = ended.out.lines().find(|line| line.starts_with(row));
        let line = line.unwrap_or_else(|| panic!("no row `{row}` in {}", ended.out));
        assert!(line.contains(" 0.000 ") || line.contains("-0.000"), "counters that stand still: {line}");
    }
    assert!(ended.out.contains("RAPL): package-0"), "{}", ended.out);
    // Without counters it says so.
    std::fs::remove_dir_all(&zone).unwrap();
    let ended = umo(&[&args[..], &["--json"]].concat()).success();
    let report: serde_json::Value = serde_json::from_str(&ended.out).unwrap();
    let taken = |name: &str| {
        let row = report["rows"].as_array().unwrap().iter().find(|row| row["row"] == name).unwrap();
        row["taken"].clone()
    };
    let (whole, mouth, held) = (taken(rows[0]), taken("one, mouth alone"), taken("one, held body"));
    if cfg!(target_os = "linux") {
        assert!(whole["joules"].is_null(), "{whole}");
        let resident = |row: &serde_json::Value| row["resident_bytes"].as_u64().unwrap();
        assert!(2 * resident(&mouth) < resident(&whole), "{mouth}, {whole}");
    }
    assert_eq!((&mouth["chunks"], &mouth["late_frames"]), (&0.into(), &0.into()));
    let (chunks, bodies) = (held["chunks"].as_u64().unwrap(), held["held_chunks"].as_u64().unwrap());
    assert!(bodies * 10 >= chunks * 8 && chunks > 0, "{held}");
}

#[test]
fn bench_refuses_numbers_out_of_range() {
    let bad = [
        (["--chunks", "0"], "--chunks 0"),
        (["--starts", "100001"], "--starts 100001"),
        (["--sessions", "0"], "--sessions 0"),
        (["--seconds", "90000"], "--seconds 90000"),
        (["--seconds", "NaN"], "--seconds NaN"),
        (["--target", "1000"], "target"),
        (["--threads", "0"], "--threads 0"),
        (["--model", "nowhere.safetensors"], "nowhere.safetensors"),
    ];
    for (args, words) in bad {
        let ended = umo(&[&["bench"], &args[..]].concat());
        assert_eq!(ended.code, 2, "{args:?}: {}", ended.err);
        assert!(ended.err.contains(words) && ended.out.is_empty(), "{args:?}: {}", ended.err);
    }
}

/// Every line of the report, the shipped model's recorded motion, and nothing that identifies the machine.
#[test]
fn doctor_finds_this_machine_sound() {
    let ended = umo(&["doctor"]).success();
    let starts: Vec<_> = ended.out.lines().map(|line| line.split_whitespace().next().unwrap()).collect();
    let wanted = ["umo", "processor", "cores", "features", "back-end", "kernels", "motion", "speed", "faster"];
    assert!(starts.starts_with(&wanted), "{}", ended.out);
    for words in ["self-test passed", "all as the reference", "as recorded: 4 frames of umo-people", "avatars at once"]
    {
        assert!(ended.out.contains(words), "no `{words}` in {}", ended.out);
    }
    assert!(!ended.out.contains(['/', '\\']), "a path: {}", ended.out);
    for variable in ["HOSTNAME", "HOME", "USER"] {
        let Ok(name) = std::env::var(variable) else { continue };
        assert!(name.len() < 3 || !ended.out.contains(&name), "{variable}: {}", ended.out);
    }
}

/// A custom model has no recorded motion, which the report says.
#[test]
fn doctor_runs_a_model_without_records_twice() {
    let model = golden("mel_k2_arkit");
    let ended = umo(&["doctor", "--model", &model, "--isa", "scalar", "--threads", "1"]).success();
    assert!(ended.out.contains("the same twice") && ended.out.contains("no reference is recorded"), "{}", ended.out);
    assert!(ended.out.contains("scalar: as was asked") && ended.out.contains("1 thread)"), "{}", ended.out);
}

#[test]
fn a_picture_that_cannot_be_written_is_refused_before_the_measurement() {
    let folder = Folder::new();
    let start = std::time::Instant::now();
    let refused = folder.refused(&["bench", "--seconds", "600", "--plot", &folder.at("missing/bench.svg")]);
    assert!(refused.contains("cannot write") && refused.contains("bench.svg"), "{refused}");
    assert!(start.elapsed() < std::time::Duration::from_secs(60));
}
