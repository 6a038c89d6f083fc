//! Whether processes can meet in shared memory.

use std::fs;
use std::path::Path;

/// Where POSIX shared memory lies.
const FOLDER: &str = "/dev/shm";
/// Space that must be free, in bytes: a comparison was seen to take 1 MB at its peak.
const LEAST: u64 = 8 << 20;

/// Free space, or what is wrong.
pub(super) fn examine() -> Result<String, String> {
    let folder = Path::new(FOLDER);
    if !folder.is_dir() {
        return Err(format!("{FOLDER} is not there"));
    }
    let probe = folder.join(format!("cardan-doctor-{}", std::process::id()));
    let written = fs::write(&probe, b"cardan");
    let removed = fs::remove_file(&probe);
    written
        .and(removed)
        .map_err(|error| format!("{FOLDER} cannot be written: {error}"))?;
    let space = rustix::fs::statvfs(folder).map_err(|error| format!("{FOLDER}: {error}"))?;
    let free = space.f_bavail * space.f_frsize;
    if free < LEAST {
        return Err(format!(
            "{FOLDER} has {} MB free; needs {} MB",
            free >> 20,
            LEAST >> 20
        ));
    }
    Ok(format!("{FOLDER}, {} MB free", free >> 20))
}
