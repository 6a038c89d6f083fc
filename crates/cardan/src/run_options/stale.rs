//! Whether an image and this program were made of the firmware sources that the user looks at.

use cardan_bench::image::Firmware;

use super::{BUNDLED_IMAGE, RunOptions};
use crate::failure::Failure;
use crate::toolchain::{Checkout, reference_digest};

/// Digest of the firmware sources that this program was compiled from; empty where they were not there.
const SOURCES: &str = env!("CARDAN_SOURCES");

/// What the checkout that the user stands in says of the image and of this program: nothing where its
/// firmware is what both were made of, where an image does not tell, and outside a checkout.
pub(super) fn told(run: &RunOptions, firmware: &Firmware) -> Result<Option<String>, Failure> {
    let Some(checkout) = Checkout::own(run.checkout.as_deref())? else {
        return Ok(None);
    };
    let Some(present) = reference_digest(&checkout) else {
        return Ok(None);
    };
    let image = firmware.sources.as_ref();
    let is_image_stale = image.is_some_and(|sources| *sources != present);
    let is_native_stale = !SOURCES.is_empty() && SOURCES != present;
    let native = "this program's native firmware";
    let image = match firmware.name.as_str() {
        BUNDLED_IMAGE => "the bundled image".to_owned(),
        file => format!("image {file}"),
    };
    let (what, program, build) = match (is_image_stale, is_native_stale) {
        (false, false) => return Ok(None),
        (true, false) => (image, "cardan", " --build"),
        (true, true) => (
            format!("{native} and {image}"),
            "cargo run --release --",
            " --build",
        ),
        (false, true) => (native.to_owned(), "cargo run --release --", " --build"),
    };
    let without_image = RunOptions {
        firmware: None,
        ..run.clone()
    };
    let arguments = without_image.arguments_here().typed();
    let command = format!("{program} compare{build}{arguments}");
    let were = if is_image_stale && is_native_stale {
        "were"
    } else {
        "was"
    };
    Ok(Some(format!(
        "{what} {were} made of other firmware sources than those in {}; to build and compare these: \
         {command}",
        checkout.root().display()
    )))
}
