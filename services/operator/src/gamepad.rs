//! Turns the readings of a gamepad into lines for the operator's socket. It needs libudev, so it is
//! behind the feature `gamepad`.

use std::path::Path;

/// A gamepad that is plugged in.
#[cfg(not(feature = "gamepad"))]
pub struct Gamepad(std::convert::Infallible);

/// A gamepad that is plugged in.
#[cfg(feature = "gamepad")]
pub struct Gamepad {
    /// The path of the socket that the thread of the gamepad waits for.
    socket: std::sync::mpsc::Sender<std::path::PathBuf>,
}

#[cfg(not(feature = "gamepad"))]
impl Gamepad {
    /// Looks for a gamepad.
    ///
    /// # Errors
    /// A sentence: the program is built without gamepads.
    pub fn open() -> Result<Self, String> {
        let build = "cargo build --release --features gamepad";
        Err(format!(
            "this armplane is built without the feature `gamepad`: build it with `{build}`, which needs libudev (Debian: libudev-dev)"
        ))
    }

    /// Sends the gamepad's readings to a session's socket until its directory is gone.
    pub fn steer(&self, _socket: &Path) {
        match self.0 {}
    }
}

#[cfg(feature = "gamepad")]
impl Gamepad {
    /// Looks for a gamepad.
    ///
    /// # Errors
    /// A sentence: none is there, or it cannot be read.
    pub fn open() -> Result<Self, String> {
        use std::sync::mpsc::channel;
        let ((socket, path), (opened, result)) = (channel::<std::path::PathBuf>(), channel());
        // The library's handle stays on the thread that made it.
        std::thread::spawn(move || match device::Device::open() {
            Ok(mut device) => {
                let _ = opened.send(Ok(()));
                // None comes where the run is refused, and one more after each roll-back.
                path.into_iter().for_each(|path| device.send_to(&path));
            }
            Err(sentence) => drop(opened.send(Err(sentence))),
        });
        result
            .recv()
            .unwrap_or_else(|_| Err("the gamepad library has given up".to_owned()))?;
        Ok(Self { socket })
    }

    /// Sends the gamepad's readings to a session's socket until its directory is gone.
    pub fn steer(&self, socket: &Path) {
        // A thread that has ended has lost its gamepad.
        let _ = self.socket.send(socket.to_owned());
    }
}

#[cfg(feature = "gamepad")]
mod device {
    use std::os::unix::net::UnixDatagram;
    use std::path::Path;
    use std::time::{Duration, Instant};

    use gilrs::{Event, EventType, Gilrs, GilrsBuilder};

    use crate::pad::{Axis, Button, Pad};

    /// Pause between two targets.
    const EVERY: Duration = Duration::from_millis(20);

    pub(super) struct Device {
        gilrs: Gilrs,
        socket: UnixDatagram,
    }

    impl Device {
        pub(super) fn open() -> Result<Self, String> {
            // The dead zone is the mapping's.
            let built = GilrsBuilder::new().with_default_filters(false).build();
            let gilrs = built.map_err(|error| format!("no gamepad can be read: {error}"))?;
            if gilrs.gamepads().next().is_none() {
                return Err(
                    "there is no gamepad: plug one in, and see that this user may read /dev/input"
                        .to_owned(),
                );
            }
            let socket = UnixDatagram::unbound().map_err(|error| format!("no socket: {error}"))?;
            Ok(Self { gilrs, socket })
        }

        /// Until the session's directory is gone.
        pub(super) fn send_to(&mut self, path: &Path) {
            let (mut pad, mut was_at_rest, mut due) = (Pad::default(), true, Instant::now());
            while path.parent().is_some_and(Path::exists) {
                let event = self.gilrs.next_event_blocking(Some(EVERY));
                if let Some(line) = event.and_then(|event| take(&mut pad, event)) {
                    self.send(&line, path);
                }
                if due > Instant::now() {
                    continue;
                }
                due = Instant::now() + EVERY;
                // Once more when everything has been let go: the arm need not wait until the target is too old.
                if !(pad.is_at_rest() && was_at_rest) {
                    self.send(&pad.line(), path);
                }
                was_at_rest = pad.is_at_rest();
            }
        }

        fn send(&self, line: &str, path: &Path) {
            // The operator may not be there yet, or no longer.
            let _ = self.socket.send_to(line.as_bytes(), path);
        }
    }

    fn take(pad: &mut Pad, Event { event, .. }: Event) -> Option<String> {
        use gilrs::{Axis as On, Button as At};
        let button = |button: At| {
            Some(match button {
                At::South => Button::South,
                At::West => Button::West,
                At::North => Button::North,
                At::LeftTrigger => Button::LeftShoulder,
                At::RightTrigger => Button::RightShoulder,
                At::DPadUp => Button::Up,
                At::DPadDown => Button::Down,
                At::Start => Button::Start,
                _ => return None,
            })
        };
        match event {
            EventType::AxisChanged(on, reading, _) => {
                let axis = match on {
                    On::LeftStickX => Axis::LeftStickX,
                    On::LeftStickY => Axis::LeftStickY,
                    On::RightStickX => Axis::RightStickX,
                    On::RightStickY => Axis::RightStickY,
                    _ => return None,
                };
                pad.tilt(axis, f64::from(reading));
            }
            EventType::ButtonChanged(At::LeftTrigger2, reading, _) => {
                pad.tilt(Axis::LeftTrigger, f64::from(reading))
            }
            EventType::ButtonChanged(At::RightTrigger2, reading, _) => {
                pad.tilt(Axis::RightTrigger, f64::from(reading))
            }
            EventType::ButtonPressed(at, _) => return pad.press(button(at)?, true),
            EventType::ButtonReleased(at, _) => return pad.press(button(at)?, false),
            EventType::Disconnected => pad.release(),
            _ => {}
        }
        None
    }
}
