//! The header of a recording: which column holds what, in which unit.

/// Standard gravity in m/s^2, by which accelerations in g are converted.
const STANDARD_GRAVITY: f64 = 9.806_65;

/// What a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum What {
    Time,
    /// Specific force along an axis, 0 to 2.
    Force(usize),
    /// Flux density along an axis, 0 to 2.
    Field(usize),
    /// A component of the reference quaternion, 0 to 3: w, x, y, z.
    Reference(usize),
}

/// Names of the contract and what they mean.
const CANONICAL: [(&str, What); 11] = [
    ("t_s", What::Time),
    ("acc_x_m_s2", What::Force(0)),
    ("acc_y_m_s2", What::Force(1)),
    ("acc_z_m_s2", What::Force(2)),
    ("mag_x_uT", What::Field(0)),
    ("mag_y_uT", What::Field(1)),
    ("mag_z_uT", What::Field(2)),
    ("ref_qw", What::Reference(0)),
    ("ref_qx", What::Reference(1)),
    ("ref_qy", What::Reference(2)),
    ("ref_qz", What::Reference(3)),
];

/// Units as they end names, with the factor to m/s^2.
const FORCE_UNITS: [(&str, f64); 8] = [
    ("m_s2", 1.0),
    ("m_s_2", 1.0),
    ("ms2", 1.0),
    ("ms_2", 1.0),
    ("mps2", 1.0),
    ("g", STANDARD_GRAVITY),
    ("mg", 1e-3 * STANDARD_GRAVITY),
    ("ug", 1e-6 * STANDARD_GRAVITY),
];

/// Units as they end names, with the factor to microtesla.
const FIELD_UNITS: [(&str, f64); 10] = [
    ("ut", 1.0),
    ("nt", 1e-3),
    ("mt", 1e3),
    ("t", 1e6),
    ("gauss", 100.0),
    ("gs", 100.0),
    ("g", 100.0),
    ("mgauss", 0.1),
    ("mg", 0.1),
    ("mgs", 0.1),
];

/// Units as they end names, with the factor to seconds.
const TIME_UNITS: [(&str, f64); 13] = [
    ("s", 1.0),
    ("sec", 1.0),
    ("secs", 1.0),
    ("seconds", 1.0),
    ("ms", 1e-3),
    ("msec", 1e-3),
    ("millis", 1e-3),
    ("milliseconds", 1e-3),
    ("us", 1e-6),
    ("usec", 1e-6),
    ("micros", 1e-6),
    ("ns", 1e-9),
    ("nanos", 1e-9),
];

const TIME_NAMES: [&str; 9] = [
    "t",
    "time",
    "timestamp",
    "ts",
    "elapsed",
    "epoch",
    "unix",
    "seconds",
    "milliseconds",
];
const FORCE_NAMES: [&str; 6] = [
    "acc",
    "accel",
    "accelerometer",
    "acceleration",
    "a",
    "accelero",
];
const FIELD_NAMES: [&str; 6] = ["mag", "magn", "magnetometer", "magnetic", "b", "m"];

/// A column in use.
#[derive(Clone, Debug)]
pub(crate) struct Column {
    pub(crate) index: usize,
    /// As it stands in the header.
    pub(crate) name: String,
    /// To seconds, m/s^2 or microtesla; for time none where the name tells no unit.
    pub(crate) factor: Option<f64>,
}

/// The columns in use.
#[derive(Clone, Debug)]
pub(crate) struct Columns {
    pub(crate) time: Column,
    pub(crate) force: [Column; 3],
    pub(crate) field: [Column; 3],
    pub(crate) reference: Option<[Column; 4]>,
}

impl Columns {
    /// None yet.
    pub(crate) fn none() -> Self {
        let none = || Column {
            index: 0,
            name: String::new(),
            factor: None,
        };
        Self {
            time: none(),
            force: std::array::from_fn(|_| none()),
            field: std::array::from_fn(|_| none()),
            reference: None,
        }
    }

    /// Finds the columns in a header. `units`, where there is such a line, tells the unit of columns
    /// whose names do not.
    ///
    /// # Errors
    /// A column is missing, stands there twice, or has no unit or an unknown one.
    pub(crate) fn find(header: &[String], units: Option<&[String]>) -> Result<Self, String> {
        let finder = Finder { header, units };
        finder.refuse_angles()?;
        let time = match finder.one(What::Time)? {
            Some(column) => column,
            None => return Err(finder.missing("t_s")),
        };
        let vector = |what: fn(usize) -> What, name: &str, unit: &str| {
            let x = finder.one(what(0))?;
            let x = x.ok_or_else(|| finder.missing(&format!("{name}_x_{unit}")))?;
            let rest = ["y", "z"].map(|axis| {
                let at = if axis == "y" { 1 } else { 2 };
                let found = finder.one(what(at))?;
                // One sensor has one unit: another one is a slip of the pen.
                let same = found.filter(|column| column.factor == x.factor);
                same.ok_or_else(|| finder.missing(&sibling(&x.name, name, axis, unit)))
            });
            let [y, z] = rest;
            Ok::<_, String>([x, y?, z?])
        };
        let force = vector(What::Force, "acc", "m_s2")?;
        let field = vector(What::Field, "mag", "uT")?;
        Ok(Self {
            time,
            force,
            field,
            reference: finder.reference()?,
        })
    }

    /// How many of the seven columns that are needed a line names.
    pub(crate) fn recognised(header: &[String]) -> usize {
        header.iter().filter(|name| meaning(name).is_some()).count()
    }
}

/// The name of another axis, after that of x.
fn sibling(x: &str, name: &str, axis: &str, unit: &str) -> String {
    let (from, to) = (format!("{name}_x_"), format!("{name}_{axis}_"));
    if x.starts_with(&from) {
        x.replacen(&from, &to, 1)
    } else {
        format!("{name}_{axis}_{unit}")
    }
}

struct Finder<'a> {
    header: &'a [String],
    units: Option<&'a [String]>,
}

impl Finder<'_> {
    fn missing(&self, name: &str) -> String {
        let found = self.header.join(", ");
        let found = match found.char_indices().nth(200) {
            Some((at, _)) => format!("{} ...", &found[..at]),
            None => found,
        };
        format!("column '{name}' is missing; the header has: {found}")
    }

    /// The column that holds `what`: by the name of the contract, else by another that says the same.
    fn one(&self, what: What) -> Result<Option<Column>, String> {
        let canonical = CANONICAL.iter().find(|(_, known)| *known == what);
        let exact =
            canonical.and_then(|(name, _)| self.header.iter().position(|cell| cell == name));
        let alike = |cell: &String| meaning(cell).is_some_and(|(known, _)| known == what);
        let mut others = (0..self.header.len()).filter(|&at| alike(&self.header[at]));
        let index = match exact {
            Some(index) => index,
            None => match (others.next(), others.next()) {
                (None, _) => return Ok(None),
                (Some(index), None) => index,
                (Some(one), Some(two)) => {
                    let (one, two) = (&self.header[one], &self.header[two]);
                    return Err(format!(
                        "columns '{one}' and '{two}' hold the same; rename the one that is not meant"
                    ));
                }
            },
        };
        let factor = self.factor(index, what)?;
        Ok(Some(Column {
            index,
            name: self.header[index].clone(),
            factor,
        }))
    }

    fn factor(&self, index: usize, what: What) -> Result<Option<f64>, String> {
        let name = &self.header[index];
        let stated = meaning(name).map_or(String::new(), |(_, unit)| unit);
        let beside = self.units.and_then(|units| units.get(index));
        let unit = match beside {
            Some(unit) if stated.is_empty() => tokens(unit).join("_"),
            _ => stated,
        };
        let (table, stem, expected): (&[(&str, f64)], &str, &str) = match what {
            What::Reference(_) => return Ok(Some(1.0)),
            What::Time => {
                let last = unit.rsplit('_').next().unwrap_or("");
                let known = TIME_UNITS.iter().find(|(known, _)| *known == last);
                return Ok(known.map(|(_, factor)| *factor));
            }
            What::Force(_) => (&FORCE_UNITS, "acc", "_m_s2, _g or _mg"),
            What::Field(_) => (&FIELD_UNITS, "mag", "_uT, _nT, _mT, _gauss or _mgauss"),
        };
        let known = table.iter().find(|(known, _)| *known == unit);
        match known {
            Some((_, factor)) => Ok(Some(*factor)),
            None if unit.is_empty() => Err(format!(
                "column '{name}' tells no unit; rename it {stem}_x, {stem}_y or {stem}_z with {expected} \
                 at its end"
            )),
            None => Err(format!(
                "column '{name}': the unit '{unit}' is not known; expected a name that ends in {expected}"
            )),
        }
    }

    fn reference(&self) -> Result<Option<[Column; 4]>, String> {
        let mut found = Vec::new();
        for at in 0..4 {
            found.push(self.one(What::Reference(at))?);
        }
        if found.iter().all(Option::is_none) {
            return Ok(None);
        }
        if let Some(at) = found.iter().position(Option::is_none) {
            let name = ["ref_qw", "ref_qx", "ref_qy", "ref_qz"][at];
            return Err(self.missing(name));
        }
        let found: Vec<Column> = found.into_iter().flatten().collect();
        Ok(<[Column; 4]>::try_from(found).ok())
    }

    /// Angles as a reference have as many meanings as makers.
    fn refuse_angles(&self) -> Result<(), String> {
        let is_angle = |cell: &&String| {
            let words = tokens(cell);
            words.first().is_some_and(|word| word == "ref")
                && words.iter().any(|word| {
                    ["roll", "pitch", "yaw", "heading", "euler"].contains(&word.as_str())
                })
        };
        match self.header.iter().find(is_angle) {
            None => Ok(()),
            Some(name) => Err(format!(
                "column '{name}': a reference in angles is not read, since their order and frame are \
                 not told; give the quaternion ref_qw, ref_qx, ref_qy, ref_qz (sensor axes to \
                 east-north-up), or rename the column"
            )),
        }
    }
}

/// What a name says that the column holds, and its unit as far as it tells.
fn meaning(name: &str) -> Option<(What, String)> {
    if let Some((_, what)) = CANONICAL.iter().find(|(known, _)| *known == name) {
        let words = tokens(name);
        let from = if *what == What::Time { 1 } else { 2 };
        return Some((*what, words.get(from..).unwrap_or(&[]).join("_")));
    }
    let words = tokens(name);
    let first = words.first()?.as_str();
    if TIME_NAMES.contains(&first) {
        let unit = if words.len() == 1 {
            &words[..]
        } else {
            &words[1..]
        };
        let is_sole = words.len() == 1 && !["seconds", "milliseconds"].contains(&first);
        return Some((
            What::Time,
            if is_sole {
                String::new()
            } else {
                unit.join("_")
            },
        ));
    }
    let axis_at = words
        .iter()
        .position(|word| ["x", "y", "z"].contains(&word.as_str()))?;
    let axis = ["x", "y", "z"]
        .iter()
        .position(|axis| *axis == words[axis_at])?;
    let unit = words[axis_at + 1..].join("_");
    let before: Vec<&str> = words[..axis_at].iter().map(String::as_str).collect();
    match before[..] {
        [one] if FORCE_NAMES.contains(&one) => Some((What::Force(axis), unit)),
        [one] | [one, "field"] if FIELD_NAMES.contains(&one) => Some((What::Field(axis), unit)),
        _ => None,
    }
}

/// The words of a name: `Acc X (m/s²)` and `accX_m_s2` are the same.
fn tokens(name: &str) -> Vec<String> {
    let mut words = vec![String::new()];
    let mut was_lower = false;
    for letter in name.chars() {
        let letter = match letter {
            '\u{b5}' | '\u{3bc}' => 'u',
            '\u{b2}' => '2',
            other => other,
        };
        let is_axis = was_lower && matches!(letter, 'X' | 'Y' | 'Z');
        if !letter.is_ascii_alphanumeric() || is_axis {
            words.push(String::new());
        }
        if letter.is_ascii_alphanumeric()
            && let Some(word) = words.last_mut()
        {
            word.push(letter.to_ascii_lowercase());
        }
        was_lower = letter.is_ascii_lowercase();
    }
    words.retain(|word| !word.is_empty());
    // ax, accx, mz, magy
    let glued = words.first().cloned().unwrap_or_default();
    if let Some((stem, axis)) = glued.split_at_checked(glued.len().saturating_sub(1))
        && ["x", "y", "z"].contains(&axis)
        && (FORCE_NAMES.contains(&stem) || FIELD_NAMES.contains(&stem))
    {
        words[0] = stem.to_owned();
        words.insert(1, axis.to_owned());
    }
    words
}
