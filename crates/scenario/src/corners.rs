//! Variations of a scenario's parameters: named corners and random units.
//!
//! A corner file is TOML:
//!
//! ```toml
//! [[corner]]
//! name = "hot"
//! set = { "climate.start_k" = 358.15, "climate.end_k" = 358.15 }
//!
//! [spread]                                   # random units, around the scenario's values
//! "sensors.accelerometer.offset_x_mg" = { sigma = 20.0 }   # normal
//! "frontend.gain_error" = { range = 0.01 }                 # uniform, to either side
//! ```
//!
//! Keys are those of the numeric parameters in `--print-scenario`. A draw that leaves a parameter's
//! admissible range is repeated.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::error::Error;
use crate::random::{Random, Source};
use crate::scenario::Scenario;
use crate::source::{self, MOST_TEXT};
use crate::syntax;

/// Draws of one value before a spread is taken to lie outside the admissible range.
const MOST_DRAWS: u32 = 1000;

/// A corner file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Corners {
    /// Named corners.
    corner: Vec<Corner>,
    /// Distributions of the random units by key.
    spread: BTreeMap<String, Spread>,
}

#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct Corner {
    name: String,
    set: BTreeMap<String, f64>,
}

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Spread {
    sigma: Option<f64>,
    range: Option<f64>,
}

/// A scenario's parameters with some set anew.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// The corner's name, or `mc-INDEX`.
    pub name: String,
    /// Keys and values that differ from the scenario's.
    pub set: Vec<(String, f64)>,
}

impl Variant {
    /// The scenario with this variant's values.
    ///
    /// # Errors
    /// An unknown key, or a value that is not admissible.
    pub fn apply(&self, scenario: &Scenario) -> Result<Scenario, Error> {
        let mut varied = scenario.clone();
        for (key, value) in &self.set {
            varied.set(key, *value)?;
        }
        varied.check()?;
        varied.name = format!("{}/{}", scenario.name, self.name);
        Ok(varied)
    }
}

impl Corners {
    /// Reads a corner file and checks its keys and values against `scenario`.
    ///
    /// # Errors
    /// Unreadable file, syntax, unknown key, inadmissible value.
    pub fn load(path: &Path, scenario: &Scenario) -> Result<Self, Error> {
        let text = source::read_text(path, MOST_TEXT).map_err(|reason| Error::Unreadable {
            path: path.into(),
            reason,
        })?;
        Self::parse(&text, &path.display().to_string(), scenario)
    }

    /// As [`Corners::load`], from text; `file` is for messages.
    ///
    /// # Errors
    /// Syntax, unknown key, inadmissible value.
    pub fn parse(text: &str, file: &str, scenario: &Scenario) -> Result<Self, Error> {
        let corners: Corners =
            toml::from_str(text).map_err(|error| syntax::explain(&error, text, file))?;
        let in_file = |error| syntax::in_file(error, text, file);
        for variant in corners.named() {
            variant.apply(scenario).map_err(in_file)?;
        }
        for (key, spread) in &corners.spread {
            scenario.get(key).map_err(in_file)?;
            spread.width(key).map_err(in_file)?;
        }
        corners.unit(scenario, 0, 0).map_err(in_file)?;
        Ok(corners)
    }

    /// The named corners in file order.
    pub fn named(&self) -> impl Iterator<Item = Variant> + '_ {
        self.corner.iter().map(|corner| Variant {
            name: corner.name.clone(),
            set: corner
                .set
                .iter()
                .map(|(key, value)| (key.clone(), *value))
                .collect(),
        })
    }

    /// Random unit number `index` under `seed`: the same whatever other units are drawn.
    ///
    /// # Errors
    /// A spread from which no admissible value can be drawn.
    pub fn unit(&self, scenario: &Scenario, seed: u64, index: u64) -> Result<Variant, Error> {
        // Each unit has 2^20 blocks of the stream to itself.
        let mut random = Random::new(seed, Source::Units).at_block(index << 20);
        let mut set = Vec::new();
        for (key, spread) in &self.spread {
            let parameter = scenario.get(key)?;
            let draw = |_| {
                let mut drawn = parameter.clone();
                drawn.value += spread.draw(&mut random);
                drawn
            };
            let value = (0..MOST_DRAWS)
                .map(draw)
                .find(|drawn| drawn.is_admissible());
            let value = value.ok_or_else(|| Error::Range {
                place: "corners".into(),
                key: format!("spread.{key}"),
                value: "no value drawn from it".into(),
                expected: format!(
                    "{} to {} {}",
                    parameter.least, parameter.most, parameter.unit
                ),
            })?;
            set.push((key.clone(), value.value));
        }
        Ok(Variant {
            name: format!("mc-{index}"),
            set,
        })
    }
}

impl Spread {
    /// Checks that exactly one width is given and usable.
    fn width(&self, key: &str) -> Result<f64, Error> {
        let one = match (self.sigma, self.range) {
            (Some(width), None) | (None, Some(width)) => Some(width),
            _ => None,
        };
        one.filter(|width| *width >= 0.0 && width.is_finite())
            .ok_or_else(|| Error::Range {
                place: "corners".into(),
                key: format!("spread.{key}"),
                value: self.shown(),
                expected: "either sigma or range, finite and not negative".into(),
            })
    }

    /// What is given, as it is written in the file.
    fn shown(&self) -> String {
        let named = [("sigma", self.sigma), ("range", self.range)];
        let given = named
            .iter()
            .filter_map(|(name, value)| Some(format!("{name} = {}", (*value)?)));
        let given: Vec<String> = given.collect();
        if given.is_empty() {
            "{}".to_owned()
        } else {
            given.join(", ")
        }
    }

    fn draw(&self, random: &mut Random) -> f64 {
        let normal = self.sigma.map(|sigma| sigma * random.normal());
        let uniform = self
            .range
            .map(|range| range * (2.0 * random.uniform() - 1.0));
        normal.or(uniform).unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = r#"
        [[corner]]
        name = "hot"
        set = { "climate.start_k" = 358.15, "sensors.magnetometer.quality" = 60 }

        [spread]
        "sensors.accelerometer.offset_x_mg" = { sigma = 20.0 }
        "frontend.gain_error" = { range = 0.01 }
    "#;

    fn message(text: &str) -> String {
        Corners::parse(text, "c.toml", &Scenario::default())
            .expect_err(text)
            .to_string()
    }

    #[test]
    fn corners_and_units_change_what_they_name_and_nothing_else() {
        let scenario = Scenario::default();
        let corners = Corners::parse(FILE, "c.toml", &scenario).expect("valid");
        let hot = corners
            .named()
            .next()
            .expect("one")
            .apply(&scenario)
            .expect("valid");
        assert_eq!(
            (hot.climate.start_k, hot.sensors.magnetometer.quality),
            (358.15, 60.0)
        );
        let changed = hot
            .parameters()
            .into_iter()
            .filter(|p| p.value != p.default)
            .count();
        assert_eq!(changed, 2);
        let unit = corners.unit(&scenario, 1, 0).expect("valid");
        let made = unit.apply(&scenario).expect("valid");
        let changed: Vec<String> = (made.parameters().into_iter())
            .filter(|p| p.value != p.default)
            .map(|p| format!("{}.{}", p.section, p.key))
            .collect();
        assert_eq!(changed.len(), 2, "{changed:?}");
        for (key, value) in &unit.set {
            assert!(changed.contains(key), "{key} = {value} in {changed:?}");
        }
    }

    #[test]
    fn units_repeat_by_seed_and_index_and_follow_their_spread() {
        let scenario = Scenario::default();
        let corners = Corners::parse(FILE, "c.toml", &scenario).expect("valid");
        let unit = |seed, index| corners.unit(&scenario, seed, index).expect("valid").set;
        assert_eq!(unit(1, 7), unit(1, 7));
        assert_ne!(unit(1, 7), unit(1, 8));
        assert_ne!(unit(1, 7), unit(2, 7));
        let n = 2000;
        let value = |index, key: &str| {
            unit(3, index)
                .into_iter()
                .find(|(k, _)| k == key)
                .expect("drawn")
                .1
        };
        let offsets: Vec<f64> = (0..n)
            .map(|i| value(i, "sensors.accelerometer.offset_x_mg"))
            .collect();
        let sigma = (offsets.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt();
        assert!((sigma / 20.0 - 1.0).abs() < 0.06, "{sigma}");
        let gains: Vec<f64> = (0..n).map(|i| value(i, "frontend.gain_error")).collect();
        assert!(gains.iter().all(|gain| gain.abs() <= 0.01));
        // Even over the range: the root mean square is the range over the root of three.
        let rms = (gains.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt();
        assert!((rms / (0.01 / 3.0_f64.sqrt()) - 1.0).abs() < 0.05, "{rms}");
    }

    #[test]
    fn every_mistake_is_told_with_its_key() {
        let unknown = message("[spread]\n\"frontend.gian_error\" = { sigma = 1 }\n");
        assert!(
            unknown.contains("c.toml") && unknown.contains("frontend.gain_error"),
            "{unknown}"
        );
        let unknown = message("[[corner]]\nname = \"a\"\nset = { \"climate.strat_k\" = 300 }\n");
        assert!(
            unknown.contains("did you mean 'climate.start_k'"),
            "{unknown}"
        );
        let range = message("[[corner]]\nname = \"a\"\nset = { \"climate.start_k\" = 3 }\n");
        assert!(
            range.contains("climate.start_k = 3") && range.contains("200 to 450"),
            "{range}"
        );
        let both = message("[spread]\n\"frontend.gain_error\" = { sigma = 1, range = 1 }\n");
        assert!(both.contains("either sigma or range"), "{both}");
        let negative = message("[spread]\n\"frontend.gain_error\" = { sigma = -1 }\n");
        assert!(negative.contains("not negative"), "{negative}");
        let key = message("[spraed]\n");
        assert!(key.contains("did you mean 'spread'"), "{key}");
    }
}
