//! Licences of all that a build compiles, against those that deny.toml allows.

use std::process::Command;

use toml::Value;

/// Whether an SPDX expression can be satisfied; the old `MIT/Apache-2.0` means OR.
struct Licence<'a> {
    tokens: Vec<String>,
    at: usize,
    is_allowed: &'a dyn Fn(&str) -> bool,
}

impl Licence<'_> {
    fn is_satisfied(expression: &str, is_allowed: &dyn Fn(&str) -> bool) -> bool {
        let spaced = expression.replace('(', " ( ").replace(')', " ) ").replace('/', " OR ");
        let tokens = spaced.split_whitespace().map(str::to_owned).collect();
        let mut licence = Licence { tokens, at: 0, is_allowed };
        let satisfied = licence.any();
        satisfied && licence.at == licence.tokens.len()
    }

    fn take(&mut self, word: &str) -> bool {
        let found = self.tokens.get(self.at).is_some_and(|token| token == word);
        self.at += usize::from(found);
        found
    }

    fn any(&mut self) -> bool {
        let mut satisfied = self.all();
        while self.take("OR") {
            satisfied |= self.all();
        }
        satisfied
    }

    fn all(&mut self) -> bool {
        let mut satisfied = self.one();
        while self.take("AND") {
            satisfied &= self.one();
        }
        satisfied
    }

    fn one(&mut self) -> bool {
        if self.take("(") {
            let satisfied = self.any();
            return self.take(")") && satisfied;
        }
        let Some(mut name) = self.tokens.get(self.at).cloned() else { return false };
        self.at += 1;
        if self.take("WITH") {
            name = format!("{name} WITH {}", self.tokens.get(self.at).map_or("", |it| it.as_str()));
            self.at += 1;
        }
        (self.is_allowed)(&name)
    }
}

#[test]
fn every_dependency_has_an_allowed_licence() {
    let deny = std::fs::read_to_string(vocaloco_tests::repository().join("deny.toml")).expect("deny.toml");
    let deny: Value = toml::from_str(&deny).expect("deny.toml is TOML");
    let names = |list: &Value| -> Vec<String> {
        let list = list["allow"].as_array().expect("allow").iter();
        list.map(|it| it.as_str().expect("a licence").to_owned()).collect()
    };
    let everywhere = names(&deny["licenses"]);
    let exceptions = deny["licenses"]["exceptions"].as_array().expect("exceptions");

    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(["tree", "--locked", "--workspace", "-e", "normal,build", "--prefix", "none"])
        .args(["--format", "{p}|{l}"])
        .current_dir(vocaloco_tests::repository())
        .output()
        .expect("cargo starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let crates = String::from_utf8(output.stdout).expect("cargo speaks UTF-8");
    let mut count = 0;
    for line in crates.lines().filter(|line| !line.is_empty()) {
        let (package, licence) = line.trim_end_matches(" (*)").split_once('|').expect("package and licence");
        let name = package.split(' ').next().unwrap_or(package);
        let mut allowed = everywhere.clone();
        for exception in exceptions.iter().filter(|it| it["crate"].as_str() == Some(name)) {
            allowed.extend(names(exception));
        }
        let is_allowed = |id: &str| allowed.iter().any(|it| it == id);
        assert!(Licence::is_satisfied(licence, &is_allowed), "{package}: licence {licence:?}, see deny.toml");
        count += 1;
    }
    assert!(count > 100, "only {count} crates looked at");
}

#[test]
fn both_halves_of_and_are_needed_and_one_of_or() {
    let is_mit = |id: &str| id == "MIT";
    for (expression, satisfied) in [
        ("MIT", true),
        ("GPL-3.0", false),
        ("GPL-3.0 OR MIT", true),
        ("GPL-3.0/MIT", true),
        ("MIT AND GPL-3.0", false),
        ("(GPL-3.0 OR MIT) AND MIT", true),
        ("(GPL-3.0 AND MIT) OR GPL-2.0", false),
        ("MIT WITH some-exception", false),
        ("", false),
    ] {
        assert_eq!(Licence::is_satisfied(expression, &is_mit), satisfied, "{expression:?}");
    }
}
