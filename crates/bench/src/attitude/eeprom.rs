//! The content of the device's EEPROM: read with reasons where it is no calibration.

use cardan_firmware::calibration::{NOMINAL, Settings};
use cardan_firmware::frame::crc16;
use cardan_scenario::{Scenario, Trajectory, report};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::{AVERAGING_AT, LEN, MAGIC, OPTIONS_AT, PERIOD_AT, VERSION, WORDS};
use cardan_spec::timing::Averaging;

use super::calibration_words;
use crate::image::{EepromImage, Firmware};

/// What the device works with: the image that the user gave, else the scenario's calibration and
/// averaging.
pub(super) fn settings_for(
    scenario: &Scenario,
    trajectory: &Trajectory,
    firmware: &Firmware,
) -> Result<Settings, String> {
    let third_tilt = scenario.sensors.third_tilt;
    match &firmware.eeprom {
        Some(image) => {
            let settings = settings(image)?;
            let read = settings.third_tilt;
            if read.is_fitted() && read != third_tilt {
                return Err(format!(
                    "{}: is of a device whose third tilt axis is '{}', in scenario {} it is '{}': set \
                     sensors.third_tilt to the former, or give the image of such a device",
                    image.name,
                    read.name(),
                    scenario.name,
                    third_tilt.name()
                ));
            }
            Ok(settings)
        }
        None => Ok(Settings {
            words: calibration_words(&report::calibration(scenario, trajectory)),
            averaging: scenario.controller.averaging().with(third_tilt),
            third_tilt,
            uncalibrated: false,
        }),
    }
}

/// The EEPROM of a nominal device at the reference site, with this third tilt axis.
#[must_use]
pub fn nominal_eeprom(third_tilt: ThirdTilt) -> Vec<u8> {
    let settings = Settings {
        words: NOMINAL,
        averaging: Averaging::DEFAULT.with(third_tilt),
        third_tilt,
        uncalibrated: false,
    };
    settings.image().to_vec()
}

/// The settings of an image; bytes behind it (the rest of a whole EEPROM) do not matter.
pub(super) fn settings(image: &EepromImage) -> Result<Settings, String> {
    let fail = |problem: String| {
        let name = &image.name;
        Err(format!(
            "{name}: {problem}; give an image that `cardan calibrate --out` has written"
        ))
    };
    let Some(head) = image.bytes.first_chunk::<LEN>() else {
        let found = image.bytes.len();
        return fail(format!(
            "holds {found} bytes; a calibration has {LEN} from address 0"
        ));
    };
    let magic = u16::from_le_bytes([head[0], head[1]]);
    if magic != MAGIC {
        return fail(format!(
            "no calibration: address 0 holds {magic:#06x}, expected the magic {MAGIC:#06x}"
        ));
    }
    if head[2] != VERSION {
        let found = head[2];
        return fail(format!(
            "layout version {found} at address 2, expected {VERSION}"
        ));
    }
    if usize::from(head[3]) != WORDS {
        let found = head[3];
        return fail(format!("{found} words at address 3, expected {WORDS}"));
    }
    let (stored, computed) = (
        u16::from_le_bytes([head[LEN - 2], head[LEN - 1]]),
        crc16(&head[..LEN - 2]),
    );
    if stored != computed {
        let at = LEN - 2;
        return fail(format!(
            "damaged: checksum {stored:#06x} at address {at}, expected {computed:#06x}"
        ));
    }
    let settings = Settings::from_image(head);
    if settings.uncalibrated {
        let (average, period) = (head[AVERAGING_AT], head[PERIOD_AT]);
        let options = head[OPTIONS_AT];
        if ThirdTilt::from_options(options).is_none() {
            return fail(format!(
                "options {options:#04x} at address {OPTIONS_AT}, expected 0 (no third tilt axis), 1 (at the \
                 comparator) or 2 (measured)"
            ));
        }
        return fail(format!(
            "averages of 2^{average} once in 2^{period} conversions at address {AVERAGING_AT}, which \
             the device does not do"
        ));
    }
    Ok(settings)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn some() -> Settings {
        Settings {
            words: std::array::from_fn(|i| i as i32 * 1_000_003),
            averaging: Averaging::new(7, 9).unwrap(),
            third_tilt: ThirdTilt::Comparator,
            uncalibrated: false,
        }
    }

    fn with(change: impl FnOnce(&mut Vec<u8>)) -> Result<Settings, String> {
        let mut bytes = some().image().to_vec();
        change(&mut bytes);
        let name = "unit.bin".to_owned();
        settings(&EepromImage { name, bytes })
    }

    /// A change of content whose checksum is right.
    fn resealed(at: usize, value: u8) -> impl FnOnce(&mut Vec<u8>) {
        move |bytes| {
            bytes[at] = value;
            let crc = crc16(&bytes[..LEN - 2]);
            bytes[LEN - 2..].copy_from_slice(&crc.to_le_bytes());
        }
    }

    #[test]
    fn settings_survive_the_image_and_bytes_behind_it_do_not_matter() {
        assert_eq!(with(|_| ()), Ok(some()));
        assert_eq!(with(|bytes| bytes.resize(1024, 0xff)), Ok(some()));
    }

    #[test]
    fn lengths_that_the_device_does_not_average_are_refused() {
        let message = with(resealed(AVERAGING_AT, 10)).unwrap_err();
        assert!(message.contains("2^10 once in 2^9"), "{message}");
    }

    #[test]
    fn options_that_the_device_does_not_know_are_refused() {
        for options in [3, 4, 0x80] {
            let message = with(resealed(OPTIONS_AT, options)).unwrap_err();
            assert!(message.contains("at address 6, expected 0"), "{message}");
        }
    }

    #[test]
    fn each_damage_is_named() {
        type Damage = fn(&mut Vec<u8>);
        let cases: [(Damage, &str); 6] = [
            (|b| b.truncate(LEN - 1), "bytes; a calibration has"),
            (|b| b[1] ^= 1, "magic"),
            (|b| b[2] += 1, "layout version"),
            (|b| b[3] -= 1, "words at address 3"),
            (|b| b[20] ^= 4, "checksum"),
            (|b| *b = vec![0xff; 1024], "magic"),
        ];
        for (damage, named) in cases {
            let message = with(damage).unwrap_err();
            assert!(
                message.starts_with("unit.bin: ") && message.contains(named),
                "{message}"
            );
        }
    }
}
