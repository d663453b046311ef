//! Package names: the documentation uses the manifests' names, and points to no other project's package.

use umo_tests::pages::{Table, files, root, tables};

/// Packages of other projects that the documentation installs.
const OTHERS: [&str; 2] = ["av", "pocketsphinx"];

fn text(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The text between `before` and `after`.
fn between<'a>(text: &'a str, before: &str, after: &str) -> &'a str {
    text.split_once(before)
        .and_then(|(_, rest)| rest.split_once(after))
        .unwrap_or_else(|| panic!("no {before}…{after}"))
        .0
}

/// The manifests of the workspace's crates.
fn manifests() -> Vec<String> {
    let workspace = text("Cargo.toml");
    let members = between(&workspace, "members = [", "]").split(',').map(|member| member.trim().trim_matches('"'));
    members.map(|member| text(&format!("{member}/Cargo.toml"))).collect()
}

fn is_published(manifest: &str) -> bool {
    !manifest.contains("publish = false")
}

fn crate_name(manifest: &str) -> String {
    between(manifest, "name = \"", "\"").to_owned()
}

fn crates() -> Vec<String> {
    manifests().iter().map(|manifest| crate_name(manifest)).collect()
}

/// Extras of the Python package.
fn extras() -> Vec<String> {
    let project = text("bindings/python/pyproject.toml");
    let table = between(&project, "[project.optional-dependencies]\n", "\n\n");
    table.lines().map(|line| line.split(" = ").next().unwrap().to_owned()).collect()
}

fn python() -> String {
    between(&text("bindings/python/pyproject.toml"), "\nname = \"", "\"").to_owned()
}

fn nuget() -> String {
    between(&text("bindings/csharp/Umo.csproj"), "<PackageId>", "</PackageId>").to_owned()
}

fn json_name(path: &str) -> String {
    between(&text(path), "\"name\": \"", "\"").to_owned()
}

/// Texts in backquotes.
fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

#[test]
fn every_registry_has_the_name_of_the_manifest() {
    let mut published: Vec<String> =
        manifests().iter().filter(|manifest| is_published(manifest)).map(|manifest| crate_name(manifest)).collect();
    published.sort();
    let mut of_python = vec![python()];
    of_python.extend(extras());
    let web = json_name("bindings/web/package.json");
    let unity = json_name("bindings/unity/package.json");
    assert!(
        text("scripts/release/archives").contains(&format!("<id>{}</id>", nuget())),
        "scripts/release/archives has another id"
    );

    let found = tables(|header| header[0] == "registry");
    let [Table { rows, .. }] = &found[..] else { panic!("not one table of names") };
    let said = |registry: &str| {
        let rows = rows.iter().filter(|row| row[0] == registry);
        let mut names: Vec<String> = rows.flat_map(|row| quoted(&row[1])).collect();
        if registry == "crates.io" {
            names.sort();
        }
        names
    };
    assert_eq!(said("crates.io"), published);
    assert_eq!(said("PyPI"), of_python);
    assert_eq!(said("npm"), [web]);
    assert_eq!(said("NuGet"), [nuget()]);
    assert_eq!(said("Unity's package manager"), [unity]);
}

/// Crates inherit the repository address; scripts/release/archives and setup.py write it into the other packages.
#[test]
fn packages_have_one_address_from_one_place() {
    let workspace = text("Cargo.toml");
    between(&workspace, "\nrepository = \"", "\"\n");
    let own =
        |text: &str, key: &str| text.lines().any(|line| line.trim_start().trim_start_matches('"').starts_with(key));
    for manifest in manifests().iter().filter(|manifest| is_published(manifest)) {
        let name = crate_name(manifest);
        assert!(manifest.contains("repository.workspace = true\n"), "{name}");
        assert!(!own(manifest, "homepage") && !own(manifest, "documentation"), "{name}");
    }
    for manifest in ["bindings/web/package.json", "bindings/unity/package.json", "bindings/python/pyproject.toml"] {
        let text = text(manifest);
        for key in ["homepage", "repository", "documentation", "[project.urls]"] {
            assert!(!own(&text, key), "{manifest}: {key}");
        }
    }
}

/// Whether a word names a file or folder, literally or by a placeholder in capitals.
fn is_path(word: &str) -> bool {
    word.contains('/')
        || [".whl", ".tgz"].iter().any(|end| word.ends_with(end))
        || word.chars().all(|letter| letter.is_ascii_uppercase() || letter == '_')
}

/// The fault of an install command, given by its words after the command's name, if any.
fn refusal(command: &str, words: &[&str]) -> Option<String> {
    let named = |word: &&&str| !word.starts_with('-');
    match command {
        "cargo install" | "cargo add" if !words.contains(&"--path") => {
            words.iter().find(named).map(|name| format!("{name} is not on crates.io"))
        }
        "dotnet add package" => (words.first() != Some(&&*nuget()) || !words.contains(&"--source"))
            .then(|| "neither ours nor from a folder".to_owned()),
        "vcpkg install" => (!words.iter().any(|word| word.starts_with("--overlay-ports=")))
            .then(|| "not from the repository".to_owned()),
        "pip install" | "pip wheel" | "npm install" => words.iter().filter(named).find_map(|word| {
            let (name, wanted) = word.strip_suffix(']').and_then(|word| word.split_once('[')).unwrap_or((word, ""));
            let unknown =
                wanted.split(',').find(|extra| !extra.is_empty() && !extras().iter().any(|ours| ours == extra));
            let is_known = is_path(name) || OTHERS.contains(&name);
            match unknown {
                Some(extra) => Some(format!("there is no extra {extra}")),
                None => (!is_known)
                    .then(|| format!("{name} is not there by that name: install by file or from the repository")),
            }
        }),
        _ => None,
    }
}

/// The first crate named to Cargo that is not one of ours.
fn strange_crate<'a>(line: &'a str, ours: &[String]) -> Option<&'a str> {
    let words: Vec<&str> = line.split([' ', '`', '"', ')', ']', ',']).collect();
    let names = words.windows(2).filter(|pair| ["-p", "--package"].contains(&pair[0])).map(|pair| pair[1]);
    names.filter(|_| line.contains("cargo")).find(|name| !ours.iter().any(|own| own == name))
}

/// Faults of one line of the documentation.
fn faults(line: &str, ours: &[String]) -> Vec<String> {
    const COMMANDS: [&str; 7] = [
        "pip install",
        "pip wheel",
        "npm install",
        "cargo install",
        "cargo add",
        "dotnet add package",
        "vcpkg install",
    ];
    let mut faults: Vec<String> =
        strange_crate(line, ours).map(|name| format!("no crate {name}")).into_iter().collect();
    for command in COMMANDS {
        for (at, _) in line.match_indices(command) {
            let rest = line[at + command.len()..].split(['`', '#', '|', ')']).next().unwrap_or_default();
            let words: Vec<&str> =
                rest.split_whitespace().map(|word| word.trim_matches(['"', '\'', ',', '.', ';', ':'])).collect();
            faults.extend(refusal(command, &words).map(|fault| format!("{command}: {fault}")));
        }
    }
    if line
        .match_indices("umo[")
        .any(|(at, found)| line[at + found.len()..].starts_with(|next: char| next.is_lowercase()))
    {
        faults.push("umo[…] is another project's package".to_owned());
    }
    faults
}

#[test]
fn install_lines_name_packages_of_ours() {
    let ours = crates();
    let mut paths = vec![];
    files(&root(), &["md", "py"], &mut paths);
    // The changelog uses the names of the time.
    paths.retain(|path| !path.ends_with("CHANGELOG.md"));
    let mut found = vec![];
    for path in &paths {
        let text = std::fs::read_to_string(path).unwrap();
        for (line, words) in text.lines().enumerate() {
            found.extend(
                faults(words, &ours).into_iter().map(|fault| format!("{}:{}: {fault}", path.display(), line + 1)),
            );
        }
    }
    assert!(paths.len() > 100, "{} pages", paths.len());
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn names_of_others_are_found() {
    let ours = crates();
    for line in [
        "`pip install umo`",
        "pip install \"umo[serve]\"",
        "pip install \"umo-avatar[serve]\" # not yet",
        "pip install \"./bindings/python[server]\"",
        "`umo[pipecat]`",
        "npm install umo-web",
        "cargo install umo-cli",
        "dotnet add package Umo --source FOLDER",
        "dotnet add package Umo.Avatar",
        "cargo run --release -p umo -- view assets/hello.wav",
        "vcpkg install umo",
    ] {
        assert!(!faults(line, &ours).is_empty(), "{line}");
    }
    for line in [
        "pip install ./bindings/python          # or: pip wheel --no-deps ./bindings/python",
        "`pip install \"FILE[serve]\"`",
        "npm install umo-web-0.1.0.tgz",
        "cargo install --path cli",
        "`cargo test --release -p umo-cli`",
    ] {
        assert_eq!(faults(line, &ours), [""; 0], "{line}");
    }
}
