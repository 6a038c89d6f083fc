//! One declaration per numeric parameter: name, default, unit, admissible range, origin, meaning.
//!
//! The `parameters!` macro makes from it the field that serde reads, the range check, the line that
//! `--print-scenario` shows and the entry in the report's list of assumptions, so that these four
//! cannot disagree.

/// Where a default value comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// Published; the text names the source as in docs/sensors.md.
    Published(&'static str),
    /// Typical or chosen; the text gives the reason.
    Assumed(&'static str),
    /// Neither physics nor design: a setting of the run.
    Setting,
}

/// One parameter with its present value.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Table of the scenario file, such as `sensors.accelerometer`.
    pub section: &'static str,
    /// Key inside the table.
    pub key: &'static str,
    /// Present value in `unit`.
    pub value: f64,
    /// Value when the key is absent.
    pub default: f64,
    /// Unit; `1` for a pure number.
    pub unit: &'static str,
    /// Least admissible value.
    pub least: f64,
    /// Largest admissible value.
    pub most: f64,
    /// Origin of the default.
    pub origin: Origin,
    /// What it means, one sentence or more.
    pub meaning: &'static str,
}

impl Parameter {
    /// True if the value is finite and inside its range.
    #[must_use]
    pub fn is_admissible(&self) -> bool {
        self.least <= self.value && self.value <= self.most
    }
}

/// A table of parameters.
pub trait Parameters {
    /// All parameters of the table with their present values, in file order.
    fn list(&self) -> Vec<Parameter>;

    /// The value of `key`, to be changed.
    fn value_mut(&mut self, key: &str) -> Option<&mut f64>;
}

/// Declares a table of `f64` parameters; see the module's text.
macro_rules! parameters {
    (
        $(#[doc = $about:literal])+
        pub struct $name:ident at $section:literal {
            $(
                $(#[doc = $doc:literal])+
                $key:ident = $default:expr, $unit:literal, $least:expr => $most:expr, $origin:expr;
            )+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Clone, Debug, PartialEq, serde::Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            $(
                $(#[doc = $doc])+
                #[doc = concat!(" Unit: ", $unit, ".")]
                pub $key: f64,
            )+
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($key: $default,)+ }
            }
        }

        impl $crate::parameter::Parameters for $name {
            fn list(&self) -> Vec<$crate::parameter::Parameter> {
                vec![$(
                    $crate::parameter::Parameter {
                        section: $section,
                        key: stringify!($key),
                        value: self.$key,
                        default: $default,
                        unit: $unit,
                        least: $least,
                        most: $most,
                        origin: $origin,
                        meaning: concat!($($doc,)+).trim_ascii(),
                    },
                )+]
            }

            fn value_mut(&mut self, key: &str) -> Option<&mut f64> {
                match key {
                    $(stringify!($key) => Some(&mut self.$key),)+
                    _ => None,
                }
            }
        }
    };
}
pub(crate) use parameters;
