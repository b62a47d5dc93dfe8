//! Baseline transports of the machine itself: a futex, a pipe and a spinning reader, without names, checks, clocks or recovery.
//!
//! One mailbox in shared memory per hop, and one pipe. A message is copied in and out; of a block a mailbox takes the header only, a pipe all
//! bytes, because it cannot do with less.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU32, Ordering};

use bytemuck::Pod;
use rustix::fs::{CWD, Mode};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use rustix::thread::futex;

use super::block::{HEADER_BYTES, HEADER_WORDS};

/// Most bytes of a message that goes through a mailbox.
const LARGEST: usize = 4096;

/// How the reader learns of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wake {
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
pub(crate) struct Mailboxes {
    boxes: NonNull<Mailbox>,
    count: usize,
    pipes: Vec<File>,
    /// The bytes of a block behind its header, on their way through a pipe.
    rest: Vec<u8>,
}

impl Mailboxes {
    /// Makes `count` empty mailboxes in a run's directory, to be opened by each process.
    ///
    /// # Errors
    /// When a file or pipe cannot be made.
    pub(crate) fn create(run: &Path, count: usize) -> std::io::Result<()> {
        std::fs::write(run.join("mailboxes"), vec![0; count * size_of::<Mailbox>()])?;
        (0..count).try_for_each(|index| {
            rustix::fs::mkfifoat(CWD, run.join(format!("pipe-{index}")), Mode::RWXU)
                .map_err(Into::into)
        })
    }

    /// Maps what [`Mailboxes::create`] made; blocks of `block_bytes` go through its pipes.
    ///
    /// # Errors
    /// When it is not there.
    pub(crate) fn open(run: &Path, count: usize, block_bytes: usize) -> std::io::Result<Self> {
        let open = |name: String| {
            OpenOptions::new()
                .read(true)
                .write(true)
                .open(run.join(name))
        };
        let file = open("mailboxes".to_owned())?;
        let size = count * size_of::<Mailbox>();
        if file.metadata()?.len() != size as u64 {
            return Err(std::io::Error::other(format!(
                "there are not {count} mailboxes"
            )));
        }
        let pipes = (0..count)
            .map(|index| open(format!("pipe-{index}")))
            .collect::<Result<_, _>>()?;
        // SAFETY: a fresh shared mapping of a file of this size; unmapped when dropped.
        let address = unsafe {
            mmap(
                std::ptr::null_mut(),
                size,
                ProtFlags::READ | ProtFlags::WRITE,
                MapFlags::SHARED,
                file,
                0,
            )?
        };
        let boxes = NonNull::new(address.cast())
            .ok_or_else(|| std::io::Error::other("mapped at address 0"))?;
        Ok(Self {
            boxes,
            count,
            pipes,
            rest: vec![0; block_bytes.saturating_sub(HEADER_BYTES)],
        })
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
    pub(crate) fn send<M: Pod>(
        &mut self,
        wake: Wake,
        index: usize,
        message: &M,
    ) -> std::io::Result<()> {
        const { assert!(size_of::<M>() <= LARGEST) };
        if wake == Wake::Pipe {
            return self.pipes[index].write_all(bytemuck::bytes_of(message));
        }
        let mailbox = self.mailbox(index);
        // SAFETY: the reader looks at these bytes only after the count below has changed, and answers before we write again.
        unsafe {
            (&raw mut (*mailbox).bytes)
                .cast::<M>()
                .write_unaligned(*message);
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
    pub(crate) fn receive<M: Pod>(&mut self, wake: Wake, index: usize) -> std::io::Result<M> {
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
                    Wake::Futex => drop(futex::wait(
                        &(*mailbox).sent,
                        futex::Flags::empty(),
                        read,
                        None,
                    )),
                    Wake::Pipe | Wake::Spin => std::hint::spin_loop(),
                }
            }
            (*mailbox)
                .read
                .store(read.wrapping_add(1), Ordering::Relaxed);
            Ok((&raw const (*mailbox).bytes).cast::<M>().read_unaligned())
        }
    }

    /// Sends a block's header; through a pipe also the bytes behind it.
    ///
    /// # Errors
    /// When the pipe fails.
    pub(crate) fn send_block(
        &mut self,
        wake: Wake,
        index: usize,
        header: &[u64; HEADER_WORDS],
    ) -> std::io::Result<()> {
        self.send(wake, index, header)?;
        if wake == Wake::Pipe {
            self.pipes[index].write_all(&self.rest)
        } else {
            Ok(())
        }
    }

    /// Waits for a block and gives its header.
    ///
    /// # Errors
    /// When the pipe fails.
    pub(crate) fn receive_block(
        &mut self,
        wake: Wake,
        index: usize,
    ) -> std::io::Result<[u64; HEADER_WORDS]> {
        let header = self.receive(wake, index)?;
        if wake == Wake::Pipe {
            self.pipes[index].read_exact(&mut self.rest)?;
        }
        Ok(header)
    }
}

impl Drop for Mailboxes {
    fn drop(&mut self) {
        // SAFETY: mapped by `open` with this size; nothing refers to it any more.
        let _ = unsafe {
            munmap(
                self.boxes.as_ptr().cast(),
                self.count * size_of::<Mailbox>(),
            )
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use runtime::RunDir;
    use shared_types::{PlantState, SensorSample};

    #[test]
    fn every_transport_hands_over_whole_messages_both_ways() {
        let run = RunDir::create().unwrap();
        Mailboxes::create(run.path(), 2).unwrap();
        let open = || Mailboxes::open(run.path(), 2, 300_000).unwrap();
        for wake in [Wake::Futex, Wake::Pipe, Wake::Spin] {
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let mut ends = open();
                    for trip in 0..100 {
                        let sample: SensorSample = ends.receive(wake, 0).unwrap();
                        let state = PlantState {
                            energy_j: sample.q_encoder[7] + 1.0,
                            ..PlantState::default()
                        };
                        ends.send(wake, 1, &state).unwrap();
                        assert_eq!(ends.receive_block(wake, 0).unwrap(), [trip; HEADER_WORDS]);
                        ends.send_block(wake, 1, &[trip; HEADER_WORDS]).unwrap();
                    }
                });
                let mut ends = open();
                for trip in 0..100_u32 {
                    let sample = SensorSample {
                        q_encoder: [f64::from(trip); 8],
                        ..SensorSample::default()
                    };
                    ends.send(wake, 0, &sample).unwrap();
                    let state: PlantState = ends.receive(wake, 1).unwrap();
                    assert_eq!(state.energy_j, f64::from(trip) + 1.0, "{wake:?}");
                    ends.send_block(wake, 0, &[u64::from(trip); HEADER_WORDS])
                        .unwrap();
                    assert_eq!(
                        ends.receive_block(wake, 1).unwrap(),
                        [u64::from(trip); HEADER_WORDS]
                    );
                }
            });
        }
    }
}
