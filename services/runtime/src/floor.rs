//! What the machine itself charges for handing a message to another process: the floors that `armplane bench` measures topics against.
//!
//! One-message mailboxes in shared memory, one per hop, without names, checks, clocks or recovery: nothing that a run needs and nothing
//! more than a hand-over costs.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};

use bytemuck::Pod;
use rustix::fs::{CWD, Mode};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::futex;

/// Most bytes of a message.
const LARGEST: usize = 4096;

/// How the reader learns of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wake {
    /// It sleeps on a futex that the writer always wakes.
    Futex,
    /// The message itself goes through a pipe.
    Pipe,
    /// It never sleeps: it reads the counter until it changes.
    Spin,
}

#[repr(C, align(64))]
struct Mailbox {
    sent: AtomicU32,
    read: AtomicU32,
    bytes: [u8; LARGEST],
}

/// One process's mapping of all mailboxes of a ring of processes. A mailbox has one writer and one reader, in turns.
pub struct Floor {
    boxes: NonNull<Mailbox>,
    count: usize,
    pipes: Vec<File>,
}

impl Floor {
    /// Makes `count` empty mailboxes in a run's directory, to be opened by each process.
    ///
    /// # Errors
    /// When a file or pipe cannot be made.
    pub fn create(run: &Path, count: usize) -> std::io::Result<()> {
        std::fs::write(run.join("floor"), vec![0; count * size_of::<Mailbox>()])?;
        (0..count).try_for_each(|index| rustix::fs::mkfifoat(CWD, run.join(format!("pipe-{index}")), Mode::RWXU).map_err(Into::into))
    }

    /// Maps what [`Floor::create`] made.
    ///
    /// # Errors
    /// When it is not there.
    pub fn open(run: &Path, count: usize) -> std::io::Result<Self> {
        let open = |name: String| OpenOptions::new().read(true).write(true).open(run.join(name));
        let file = open("floor".to_owned())?;
        let size = count * size_of::<Mailbox>();
        if file.metadata()?.len() != size as u64 {
            return Err(std::io::Error::other(format!("the floor has not {count} mailboxes")));
        }
        let pipes = (0..count).map(|index| open(format!("pipe-{index}"))).collect::<Result<_, _>>()?;
        // SAFETY: a fresh shared mapping of a file of this size; unmapped when dropped.
        let address = unsafe { mmap(std::ptr::null_mut(), size, ProtFlags::READ | ProtFlags::WRITE, MapFlags::SHARED, file, 0)? };
        let boxes = NonNull::new(address.cast()).ok_or_else(|| std::io::Error::other("mapped at address 0"))?;
        Ok(Self { boxes, count, pipes })
    }

    fn mailbox(&self, index: usize) -> *mut Mailbox {
        assert!(index < self.count, "mailbox {index} of {}", self.count);
        // SAFETY: `count` boxes are mapped.
        unsafe { self.boxes.as_ptr().add(index) }
    }

    /// Writes a message into a mailbox and wakes its reader.
    ///
    /// # Errors
    /// When the pipe fails.
    pub fn send<M: Pod>(&mut self, wake: Wake, index: usize, message: &M) -> std::io::Result<()> {
        const { assert!(size_of::<M>() <= LARGEST) };
        if wake == Wake::Pipe {
            return self.pipes[index].write_all(bytemuck::bytes_of(message));
        }
        let mailbox = self.mailbox(index);
        // SAFETY: the reader looks at these bytes only after the count below has changed, and answers before we write again.
        unsafe {
            (&raw mut (*mailbox).bytes).cast::<M>().write_unaligned(*message);
            (*mailbox).sent.fetch_add(1, Ordering::Release);
            if wake == Wake::Futex {
                let _ = futex::wake(&(*mailbox).sent, futex::Flags::empty(), 1);
            }
        }
        Ok(())
    }

    /// Waits for a message in a mailbox and copies it out.
    ///
    /// # Errors
    /// When the pipe fails.
    pub fn receive<M: Pod>(&mut self, wake: Wake, index: usize) -> std::io::Result<M> {
        const { assert!(size_of::<M>() <= LARGEST) };
        if wake == Wake::Pipe {
            let mut message = M::zeroed();
            self.pipes[index].read_exact(bytemuck::bytes_of_mut(&mut message))?;
            return Ok(message);
        }
        let mailbox = self.mailbox(index);
        // SAFETY: as in `send`.
        unsafe {
            let read = (*mailbox).read.load(Ordering::Relaxed);
            while (*mailbox).sent.load(Ordering::Acquire) == read {
                match wake {
                    Wake::Futex => drop(futex::wait(&(*mailbox).sent, futex::Flags::empty(), read, None)),
                    Wake::Pipe | Wake::Spin => std::hint::spin_loop(),
                }
            }
            (*mailbox).read.store(read.wrapping_add(1), Ordering::Relaxed);
            Ok((&raw const (*mailbox).bytes).cast::<M>().read_unaligned())
        }
    }
}

impl Drop for Floor {
    fn drop(&mut self) {
        // SAFETY: mapped by `open` with this size; nothing refers to it any more.
        let _ = unsafe { munmap(self.boxes.as_ptr().cast(), self.count * size_of::<Mailbox>()) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RunDir;
    use shared_types::{PlantState, SensorSample};

    #[test]
    fn every_floor_hands_over_whole_messages_both_ways() {
        let run = RunDir::create().unwrap();
        Floor::create(run.path(), 2).unwrap();
        let open = || Floor::open(run.path(), 2).unwrap();
        for wake in [Wake::Futex, Wake::Pipe, Wake::Spin] {
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let mut floor = open();
                    for _ in 0..100 {
                        let sample: SensorSample = floor.receive(wake, 0).unwrap();
                        let state = PlantState { energy_j: sample.q_encoder[7] + 1.0, ..PlantState::default() };
                        floor.send(wake, 1, &state).unwrap();
                    }
                });
                let mut floor = open();
                for trip in 0..100 {
                    let sample = SensorSample { q_encoder: [f64::from(trip); 8], ..SensorSample::default() };
                    floor.send(wake, 0, &sample).unwrap();
                    let state: PlantState = floor.receive(wake, 1).unwrap();
                    assert_eq!(state.energy_j, f64::from(trip) + 1.0, "{wake:?}");
                }
            });
        }
    }
}
