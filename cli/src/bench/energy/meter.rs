//! Energy of the machine as Linux and Android report it: counters of the processor's packages (RAPL), or the battery.

use std::path::{Path, PathBuf};
use std::time::Instant;

/// Microjoules to joules.
const MICRO: f64 = 1e-6;

/// Where energy is read.
#[derive(Debug)]
pub(super) struct Meter {
    zones: Vec<Zone>,
    battery: Option<Battery>,
    /// Whether there are counters that this user may not read.
    is_locked: bool,
    sys: PathBuf,
}

/// A counter of microjoules that begins anew at its greatest value.
#[derive(Debug)]
struct Zone {
    name: String,
    file: PathBuf,
    most: u64,
    last: u64,
    sum: u64,
}

/// A battery that tells its power; of its charge alone a short measurement sees no step.
#[derive(Debug)]
struct Battery {
    folder: PathBuf,
    started: Option<(Instant, f64)>,
}

impl Meter {
    /// Finds the meters in a folder such as `/sys`.
    pub(super) fn open(sys: &Path) -> Self {
        let (mut zones, mut is_locked) = (Vec::new(), false);
        for folder in folders(&sys.join("class/powercap")) {
            let Some(name) = text(&folder.join("name")) else { continue };
            // Packages, and the memory beside them; the parts of a package are in its own counter.
            let is_part = !(name.starts_with("package") || name == "psys" || name == "dram");
            if is_part || !folder.join("energy_uj").exists() {
                continue;
            }
            match (number(&folder.join("energy_uj")), number(&folder.join("max_energy_range_uj"))) {
                (Some(last), most) => {
                    let most = most.unwrap_or(u64::MAX);
                    zones.push(Zone { name, file: folder.join("energy_uj"), most, last, sum: 0 });
                }
                (None, _) => is_locked = true,
            }
        }
        // The whole machine has all others in it.
        if zones.iter().any(|zone| zone.name == "psys") {
            zones.retain(|zone| zone.name == "psys");
        }
        let batteries = folders(&sys.join("class/power_supply")).into_iter();
        let mut batteries = batteries.filter(|folder| text(&folder.join("type")).as_deref() == Some("Battery"));
        let battery = batteries.find(|folder| watts(folder).is_some()).map(|folder| Battery { folder, started: None });
        Self { zones, battery, is_locked, sys: sys.to_owned() }
    }

    /// Starts to measure.
    pub(super) fn start(&mut self) {
        for zone in &mut self.zones {
            (zone.last, zone.sum) = (number(&zone.file).unwrap_or(zone.last), 0);
        }
        if let Some(battery) = &mut self.battery {
            battery.started = watts(&battery.folder).map(|watts| (Instant::now(), watts));
        }
    }

    /// Joules since the start; `None` if nothing here tells them.
    pub(super) fn joules(&mut self) -> Option<f64> {
        if self.zones.is_empty() {
            let Battery { folder, started } = self.battery.as_ref()?;
            let (start, before) = (*started)?;
            return Some(0.5 * (before + watts(folder)?) * start.elapsed().as_secs_f64());
        }
        for zone in &mut self.zones {
            zone.read()?;
        }
        Some(self.zones.iter().map(|zone| zone.sum as f64 * MICRO).sum())
    }

    /// The quantity measured, for people.
    pub(super) fn sources(&self) -> String {
        let names: Vec<_> = self.zones.iter().map(|zone| &*zone.name).collect();
        match (&*names, &self.battery) {
            ([], None) if cfg!(target_vendor = "apple") => "this process, as the system bills it".to_owned(),
            ([], None) => "nothing: this system tells no joules".to_owned(),
            ([], Some(_)) => "the battery, by its power at both ends of a row: the whole machine".to_owned(),
            (names, _) => format!("the processor's counters (RAPL): {}", names.join(", ")),
        }
    }

    /// The reason why joules are missing, and the remedy.
    pub(super) fn missing(&self) -> String {
        let place = self.sys.join("class/powercap");
        if self.is_locked {
            return format!(
                "only root may read the counters: `sudo chmod a+r {}/intel-rapl*/energy_uj`, or run as root",
                place.display()
            );
        }
        if cfg!(windows) {
            return "Windows tells a program none: `powercfg /srumutil` has the system's estimate for it".to_owned();
        }
        format!(
            "{} has no counter: a virtual machine has none, a processor of Intel or AMD has them with the module \
             intel_rapl_msr; a laptop or phone tells its battery's power while it is not charged; or use a wall meter",
            place.display()
        )
    }
}

impl Zone {
    /// Adds what was used since the last reading.
    fn read(&mut self) -> Option<()> {
        let now = number(&self.file)?;
        self.sum += match now.checked_sub(self.last) {
            Some(more) => more,
            // It began anew: at most once, as a range lasts for minutes.
            None => (self.most - self.last.min(self.most)).saturating_add(now),
        };
        self.last = now;
        Some(())
    }
}

/// The reason why instructions and cycles are missing, and the remedy.
pub(super) fn no_counters(sys: &Path) -> String {
    let is_virtual = folders(&sys.join("bus/event_source/devices")).iter().all(|folder| {
        folder
            .file_name()
            .is_some_and(|name| !name.to_string_lossy().starts_with("cpu") && !name.to_string_lossy().contains("pmu"))
    });
    let level = text(Path::new("/proc/sys/kernel/perf_event_paranoid")).and_then(|text| text.parse::<i32>().ok());
    match level {
        None => "this system has no perf_event_open".to_owned(),
        Some(_) if is_virtual => "the processor's counters are not passed to this virtual machine".to_owned(),
        Some(level) if level > 2 => {
            format!("perf_event_paranoid is {level}: `sudo sysctl kernel.perf_event_paranoid=2`, or run as root")
        }
        Some(_) => "perf_event_open is refused, as in most containers: run outside of one".to_owned(),
    }
}

/// Power of a battery that is being discharged, watts.
fn watts(folder: &Path) -> Option<f64> {
    let status = text(&folder.join("status"))?;
    if status != "Discharging" {
        return None;
    }
    // Some systems count what flows out as negative.
    let signed = |name: &str| text(&folder.join(name))?.parse::<f64>().ok().map(|value| value.abs() * MICRO);
    signed("power_now").or_else(|| Some(signed("current_now")? * signed("voltage_now")?)).filter(|&watts| watts > 0.0)
}

/// Folders in a folder, in the order of their names.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut all: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir()).collect();
    all.sort();
    all
}

fn text(file: &Path) -> Option<String> {
    Some(std::fs::read_to_string(file).ok()?.trim().to_owned())
}

fn number(file: &Path) -> Option<u64> {
    text(file)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, format!("{text}\n")).unwrap();
        }
        root
    }

    const PACKAGE: &str = "class/powercap/intel-rapl:0";

    #[test]
    fn counters_are_added_and_may_begin_anew() {
        let files = [
            ("class/powercap/intel-rapl:0/name", "package-0"),
            ("class/powercap/intel-rapl:0/energy_uj", "9000000"),
            ("class/powercap/intel-rapl:0/max_energy_range_uj", "10000000"),
            ("class/powercap/intel-rapl:0:0/name", "core"),
            ("class/powercap/intel-rapl:0:0/energy_uj", "5"),
            ("class/powercap/intel-rapl:0:1/name", "dram"),
            ("class/powercap/intel-rapl:0:1/energy_uj", "1000000"),
            ("class/powercap/intel-rapl:0:1/max_energy_range_uj", "10000000"),
            ("class/powercap/intel-rapl/enabled", "1"),
        ];
        let root = folder(&files);
        let set = |zone: &str, value: u64| {
            std::fs::write(root.path().join(format!("{zone}/energy_uj")), format!("{value}\n")).unwrap();
        };
        let mut meter = Meter::open(root.path());
        assert!(meter.sources().contains("package-0, dram"), "{}", meter.sources());
        set(PACKAGE, 9_200_000);
        meter.start();
        assert_eq!(meter.joules(), Some(0.0));
        // 0.8 J up to the end of the range and 0.7 after it; 2 J of the memory.
        set(PACKAGE, 700_000);
        set("class/powercap/intel-rapl:0:1", 3_000_000);
        assert!((meter.joules().unwrap() - 3.5).abs() < 1e-9);
        set(PACKAGE, 900_000);
        assert!((meter.joules().unwrap() - 3.7).abs() < 1e-9);
        // The whole machine counts alone, where it is told.
        let all = [
            &files[..],
            &[("class/powercap/intel-rapl:1/name", "psys"), ("class/powercap/intel-rapl:1/energy_uj", "7")],
        ];
        assert!(Meter::open(folder(&all.concat()).path()).sources().ends_with(": psys"));
    }

    #[test]
    fn what_cannot_be_read_is_said() {
        // A folder in place of the file: it is there, and cannot be read.
        let root = folder(&[
            ("class/powercap/intel-rapl:0/name", "package-0"),
            ("class/powercap/intel-rapl:0/energy_uj/x", ""),
        ]);
        let mut meter = Meter::open(root.path());
        meter.start();
        assert_eq!(meter.joules(), None);
        assert!(meter.missing().contains("chmod a+r"), "{}", meter.missing());
        let root = folder(&[("class/power_supply/AC/type", "Mains")]);
        let mut meter = Meter::open(root.path());
        meter.start();
        assert_eq!(meter.joules(), None);
        assert!(meter.missing().contains("no counter"), "{}", meter.missing());
        // No `cpu` among the sources of events.
        let root = folder(&[("bus/event_source/devices/software/type", "1")]);
        if Path::new("/proc/sys/kernel/perf_event_paranoid").exists() {
            assert!(no_counters(root.path()).contains("virtual"), "{}", no_counters(root.path()));
        }
    }

    #[test]
    fn a_battery_tells_its_power_while_it_is_discharged() {
        let of = |files: &[(&str, &str)]| {
            let files: Vec<_> =
                files.iter().map(|(name, text)| (format!("class/power_supply/BAT0/{name}"), *text)).collect();
            let files: Vec<_> = files.iter().map(|(name, text)| (&**name, *text)).collect();
            folder(&files)
        };
        let root = of(&[("type", "Battery"), ("status", "Discharging"), ("power_now", "8000000")]);
        let mut meter = Meter::open(root.path());
        meter.start();
        std::thread::sleep(std::time::Duration::from_millis(100));
        let joules = meter.joules().unwrap();
        assert!((0.7..8.0).contains(&joules), "{joules}");
        // A phone's: current, negative, and voltage.
        let root = of(&[
            ("type", "Battery"),
            ("status", "Discharging"),
            ("current_now", "-500000"),
            ("voltage_now", "4000000"),
        ]);
        assert_eq!(watts(&root.path().join("class/power_supply/BAT0")), Some(2.0));
        let root = of(&[("type", "Battery"), ("status", "Charging"), ("power_now", "8000000")]);
        assert!(Meter::open(root.path()).battery.is_none());
    }
}
