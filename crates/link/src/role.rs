//! The participants of a session and the direction in which data flows between them.

use std::fmt;
use std::str::FromStr;

/// One participant of a session. Data flows from [`Emulated`](Role::Emulated) through
/// [`Native`](Role::Native) and [`Golden`](Role::Golden) to [`Diff`](Role::Diff), never back.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Role {
    /// The emulated controller: owns the analog side, publishes conversions, nodes and frames.
    Emulated,
    /// The firmware crate on the host: consumes codes, publishes raw node words and frames.
    Native,
    /// The f64 model: consumes codes and ideal voltages, publishes real node values.
    Golden,
    /// The judge: consumes everything, publishes nothing.
    Diff,
}

impl Role {
    /// Every role, upstream first.
    pub const ALL: [Self; 4] = [Self::Emulated, Self::Native, Self::Golden, Self::Diff];

    /// The name that users type and read, as in `cardan native`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Emulated => "emulated",
            Self::Native => "native",
            Self::Golden => "golden",
            Self::Diff => "diff",
        }
    }

    /// Position in [`Role::ALL`].
    pub(crate) const fn index(self) -> usize {
        self as usize
    }

    pub(crate) fn from_index(index: u8) -> Option<Self> {
        Self::ALL.get(usize::from(index)).copied()
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Role {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL
            .into_iter()
            .find(|role| role.name() == text)
            .ok_or_else(|| format!("no role is called '{text}': {}", list(&Self::ALL)))
    }
}

/// Writes roles for a message: `golden`, `native and golden`, `emulated, native and golden`.
pub(crate) fn list(roles: &[Role]) -> String {
    match roles {
        [] => "nobody".to_owned(),
        [one] => one.to_string(),
        [head @ .., last] => {
            let head: Vec<_> = head.iter().map(|role| role.name()).collect();
            format!("{} and {last}", head.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_role_is_parsed_from_its_own_name_and_found_at_its_index() {
        for role in Role::ALL {
            assert_eq!(role.name().parse(), Ok(role));
            assert_eq!(Role::from_index(role.index() as u8), Some(role));
        }
        assert_eq!(Role::from_index(4), None);
        assert!("golem".parse::<Role>().is_err());
    }

    #[test]
    fn roles_are_listed_as_a_sentence_would() {
        assert_eq!(list(&[Role::Golden]), "golden");
        assert_eq!(list(&[Role::Native, Role::Golden]), "native and golden");
        assert_eq!(list(&Role::ALL), "emulated, native, golden and diff");
    }
}
