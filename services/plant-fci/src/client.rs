//! The robot at its address. Only this file uses the FCI client.

use franka::{
    ActiveTorqueControl, FrankaError, RealtimeConfig, Robot, RobotMode, RobotOptions, RobotState,
    Torques,
};
use nalgebra::SVector;

use crate::address::Address;
use crate::cycle::Measured;
use crate::error::RobotFailure;
use crate::interface::JOINTS;

/// A connection to the robot's control.
pub(crate) struct Client {
    robot: Robot,
    address: Address,
}

impl Client {
    /// Real-time priority is the shell's to take, so the client neither asks for it nor for a real-time kernel.
    pub(crate) fn connect(address: &Address) -> Result<Self, RobotFailure> {
        let options = RobotOptions::new(RealtimeConfig::Ignore).with_log_size(0);
        let robot = Robot::with_options(&address.host, options).map_err(|error| match error {
            FrankaError::IncompatibleVersion { server_version, .. } => RobotFailure::Version {
                address: address.clone(),
                theirs: server_version,
            },
            other => RobotFailure::Unreachable {
                address: address.clone(),
                reason: words(&other),
            },
        })?;
        Ok(Self {
            robot,
            address: address.clone(),
        })
    }

    pub(crate) fn state(&self) -> Result<RobotState, RobotFailure> {
        self.robot
            .read_once()
            .map_err(|error| self.failure(0, &error))
    }

    /// Whether a motion can begin.
    pub(crate) fn check_ready(&self) -> Result<(), RobotFailure> {
        let state = self.state()?;
        let remedy = match state.robot_mode {
            RobotMode::Idle => return Ok(()),
            RobotMode::Reflex => "acknowledge its error in Desk, or start the simulator again",
            RobotMode::UserStopped => "release the user stop",
            RobotMode::Guiding => "let go of the guiding button",
            RobotMode::Move => "another program moves it: end that one",
            RobotMode::Other | RobotMode::AutomaticErrorRecovery => {
                "see Desk: unlock the joints and activate FCI"
            }
        };
        let errors = if state.current_errors.any() {
            format!(" with the errors {}", state.current_errors)
        } else {
            String::new()
        };
        Err(RobotFailure::NotReady {
            address: self.address.clone(),
            mode: state.robot_mode.to_string(),
            errors,
            remedy,
        })
    }

    /// Its URDF; `None` from FCI version 5, which has no `GetRobotModel`.
    pub(crate) fn urdf(&self) -> Result<Option<String>, RobotFailure> {
        match self.robot.robot_model() {
            Ok(urdf) => Ok(Some(urdf)),
            Err(FrankaError::InvalidOperation(_)) => Ok(None),
            Err(error) => Err(self.refused("give its URDF", &error)),
        }
    }

    /// From now on each state is to be answered by a torque.
    pub(crate) fn control(&self) -> Result<Controlled<'_>, RobotFailure> {
        let control = self
            .robot
            .start_torque_control()
            .map_err(|error| self.refused("begin torque control", &error))?;
        Ok(Controlled {
            client: self,
            control,
            rates: Rates::default(),
        })
    }

    fn refused(&self, action: &'static str, error: &FrankaError) -> RobotFailure {
        match error {
            FrankaError::Network(_) => self.failure(0, error),
            _ => RobotFailure::Refused {
                address: self.address.clone(),
                action,
                reason: words(error),
            },
        }
    }

    fn failure(&self, tick: u64, error: &FrankaError) -> RobotFailure {
        match error {
            FrankaError::Control(stopped) => {
                let errors = if stopped.last_motion_errors.any() {
                    stopped.last_motion_errors.to_string()
                } else {
                    words(error)
                };
                RobotFailure::Reflex { tick, errors }
            }
            other => RobotFailure::Lost {
                address: self.address.clone(),
                tick,
                reason: words(other),
            },
        }
    }
}

/// The share of commands that the robot received in time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rates {
    /// Of the last 100, the least of the run.
    pub(crate) least: f64,
    /// The mean over the run.
    sum: f64,
    count: u64,
    /// States that did not reach this program.
    pub(crate) missed: u64,
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            least: 1.0,
            sum: 0.0,
            count: 0,
            missed: 0,
        }
    }
}

impl Rates {
    /// The robot's own window is of 100 commands.
    const WINDOW: u64 = 100;

    fn note(&mut self, rate: f64, passed: u64) {
        self.missed += passed.saturating_sub(1);
        self.count += 1;
        if self.count > Self::WINDOW {
            self.least = self.least.min(rate);
            self.sum += rate;
        }
    }

    /// Mean of the robot's own success rate.
    pub(crate) fn mean(&self) -> f64 {
        if self.count > Self::WINDOW {
            self.sum / (self.count - Self::WINDOW) as f64
        } else {
            1.0
        }
    }
}

/// The robot under torque control; the arm is stopped when it is dropped.
pub(crate) struct Controlled<'a> {
    client: &'a Client,
    control: ActiveTorqueControl<'a>,
    rates: Rates,
}

impl Controlled<'_> {
    /// The next state, and how many ticks of the robot's clock have passed since the one before.
    pub(crate) fn next(&mut self, tick: u64) -> Result<(Measured, u64), RobotFailure> {
        let (state, period) = self
            .control
            .read_once()
            .map_err(|error| self.client.failure(tick, &error))?;
        let passed = period.as_millis();
        self.rates.note(state.control_command_success_rate, passed);
        let now = measured(&state);
        if !now.is_finite() {
            let reason = "its state holds a number that is not finite".to_owned();
            return Err(RobotFailure::Lost {
                address: self.client.address.clone(),
                tick,
                reason,
            });
        }
        Ok((now, passed))
    }

    pub(crate) fn send(&mut self, tick: u64, tau: [f64; JOINTS]) -> Result<(), RobotFailure> {
        self.control
            .write_once(&Torques::new(tau))
            .map_err(|error| self.client.failure(tick, &error))
    }

    /// Ends the torque control: the robot holds the arm itself.
    pub(crate) fn finish(mut self, tick: u64, tau: [f64; JOINTS]) -> Result<Rates, RobotFailure> {
        let last = franka::motion_finished(Torques::new(tau));
        self.control
            .write_once(&last)
            .map_err(|error| self.client.failure(tick, &error))?;
        Ok(self.rates)
    }

    pub(crate) fn rates(&self) -> Rates {
        self.rates
    }
}

pub(crate) fn measured(state: &RobotState) -> Measured {
    Measured {
        q: SVector::from(state.q),
        qdot: SVector::from(state.dq),
        tau_in_force: SVector::from(state.tau_J_d),
    }
}

/// The client's words on one line, without its name in front.
fn words(error: &FrankaError) -> String {
    let text = error.to_string();
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let line = line
        .trim_start_matches("libfranka robot: ")
        .trim_start_matches("libfranka: ");
    line.trim_end_matches(['.', '!']).to_owned()
}
