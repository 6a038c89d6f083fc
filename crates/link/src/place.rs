//! Where the sessions of a user live. iceoryx2's own folder and names, unless they belong to another
//! user of this machine: what that user made can be neither read nor removed, so this one gets a folder
//! and names of their own.

use std::fs;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::OnceLock;

use iceoryx2::config::Config;
use iceoryx2::prelude::{FileName, Path as LinkPath, SemanticString as _};

use crate::resources::SHARED_MEMORY;

/// Names of segments that stay when all sessions are gone.
const MANAGEMENT: &str = ".global_mgmt";

/// A folder and a prefix of names.
type Own = Option<(LinkPath, FileName)>;

/// Moves the sessions where they can live. Decided once per process; children and other terminals of the
/// same user come to the same.
pub(crate) fn settle(config: &mut Config) {
    static OWN: OnceLock<Own> = OnceLock::new();
    if let Some((root, prefix)) = OWN.get_or_init(|| own(config)) {
        config.global.set_root_path(root);
        config.global.prefix = *prefix;
    }
}

/// A place of one's own, if the usual one is somebody else's.
fn own(config: &Config) -> Own {
    // Where the system does not tell who we are, everything stays as it is.
    let user = fs::metadata("/proc/self").ok()?.uid();
    let root = config.global.root_path().to_string();
    let root = root.trim_end_matches('/');
    let prefix = config.global.prefix.to_string();
    let is_taken = is_foreign(Path::new(root), user) || has_foreign_segment(&prefix, user);
    if !is_taken {
        return None;
    }
    let root = LinkPath::new(format!("{root}-{user}/").as_bytes()).ok()?;
    let prefix = FileName::new(format!("{prefix}u{user}_").as_bytes()).ok()?;
    Some((root, prefix))
}

pub(crate) fn is_foreign(path: &Path, user: u32) -> bool {
    fs::metadata(path).is_ok_and(|there| there.uid() != user)
}

/// Whether another user has a management segment of the usual names.
fn has_foreign_segment(prefix: &str, user: u32) -> bool {
    let entries = fs::read_dir(SHARED_MEMORY).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        let usual = name.strip_prefix(prefix);
        // A user's own begin with a `u`, hashes with a digit of base 16.
        let is_usual = usual.is_some_and(|rest| !rest.starts_with('u'));
        is_usual && name.ends_with(MANAGEMENT) && is_foreign(&entry.path(), user)
    })
}
