//! A Cortex-M with semihosting.
//!
//! Unsafe code is here only: statics that `main` alone touches, the recording that the emulator put into memory, the stack's paint,
//! and the semihosting call for the command line.

use core::panic::PanicInfo;
use core::ptr::{addr_of, addr_of_mut};
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;
use cortex_m_rt::{ExceptionFrame, entry, exception};
use cortex_m_semihosting::debug::{EXIT_FAILURE, EXIT_SUCCESS, exit};
use cortex_m_semihosting::hio::{HostStream, hstdout};
use libella_core::estimator::Place;
use libella_core::profile::{Micro, MicroPyramids};

use libella_firmware_sim::cycles::Clock;
use libella_firmware_sim::memory;
use libella_firmware_sim::replay::{HEADER_BYTES, Header, Replay};
use libella_firmware_sim::schedule::{Plan, fly};
use libella_firmware_sim::telemetry::{Line, Telemetry};

/// The one estimator. Zeros, so that it takes no flash.
static mut ESTIMATOR: Place<Micro> = Place::new();
/// The images that it compares.
static mut PYRAMIDS: MicroPyramids = MicroPyramids::new();

/// What unused stack is filled with.
const PAINT: u32 = 0xa5a5_5a5a;

unsafe extern "C" {
    /// End of the static memory, from the linker script.
    static mut __sheap: u32;
    /// Top of the stack, from the linker script.
    static mut _stack_start: u32;
}

struct Semihosting(HostStream);

impl Telemetry for Semihosting {
    fn send(&mut self, line: &[u8]) {
        // With nobody listening there is nothing to be done.
        let _ = self.0.write_all(line);
    }
}

/// The system timer: 24 bits, counting down; every time it ends, [`WRAPS`] counts one.
struct Timer;

/// Bits of the system timer.
const TIMER_BITS: u32 = 24;
/// How often the system timer has come to its end.
static WRAPS: AtomicU32 = AtomicU32::new(0);

impl Timer {
    fn new(mut timer: SYST) -> Self {
        timer.set_clock_source(SystClkSource::Core);
        timer.set_reload((1 << TIMER_BITS) - 1);
        timer.clear_current();
        timer.enable_interrupt();
        timer.enable_counter();
        Self
    }
}

impl Clock for Timer {
    #[inline(never)]
    fn now(&mut self) -> u32 {
        loop {
            let wraps = WRAPS.load(Ordering::Relaxed);
            let left = SYST::get_current();
            if wraps == WRAPS.load(Ordering::Relaxed) {
                return (wraps << TIMER_BITS).wrapping_add(((1 << TIMER_BITS) - 1) - left);
            }
        }
    }

    fn end_of_image(&mut self) {
        libella_end_of_image();
    }
}

#[exception]
fn SysTick() {
    WRAPS.fetch_add(1, Ordering::Relaxed);
}

/// A place in the code that an emulator can wait for.
#[unsafe(no_mangle)]
#[inline(never)]
extern "C" fn libella_end_of_image() {
    cortex_m::asm::nop();
}

#[entry]
fn main() -> ! {
    let top = paint_stack();
    let (Some(peripherals), Ok(stream)) = (cortex_m::Peripherals::take(), hstdout()) else { leave(false) };
    let (mut clock, mut telemetry) = (Timer::new(peripherals.SYST), Semihosting(stream));
    calibrate(&mut clock, &mut telemetry);
    let mut buffer = [0_u8; 80];
    let Some((replay, plan)) = read_command_line(&mut buffer).and_then(parse) else {
        Line::new("no recording").send(&mut telemetry);
        leave(false)
    };
    // SAFETY: `main` runs once and nothing else names the statics, so both references are the only ones.
    let (place, pyramids) = unsafe { (&mut *addr_of_mut!(ESTIMATOR), &mut *addr_of_mut!(PYRAMIDS)) };
    let estimator = memory::build(place, &replay);
    let started = high_water(top);
    paint_stack();
    fly(&replay, plan, estimator, pyramids, &mut clock, &mut telemetry);
    Line::new("stack start").decimal(started).word("peak").decimal(high_water(top)).send(&mut telemetry);
    Line::new("memory estimator")
        .decimal(size_of::<Micro>() as u32)
        .word("pyramids")
        .decimal(size_of::<MicroPyramids>() as u32)
        .send(&mut telemetry);
    leave(true)
}

/// How many instructions a tick of the clock is, from a loop of known length: ticks of a million instructions.
fn calibrate(clock: &mut Timer, telemetry: &mut Semihosting) {
    let begun = clock.now();
    // SAFETY: counts a register down; two instructions a round.
    unsafe { core::arch::asm!("1: subs {0}, {0}, #1", "bne 1b", inout(reg) 500_000_u32 => _) };
    let ended = clock.now();
    Line::new("ticks").decimal(ended.wrapping_sub(begun)).send(telemetry);
}

/// Fills the unused stack, and says where its top is.
#[inline(never)]
fn paint_stack() -> usize {
    let bottom = addr_of!(__sheap) as usize;
    // Far enough below what this function uses itself.
    let end = cortex_m::register::msp::read() as usize - 256;
    for address in (bottom..end).step_by(4) {
        // SAFETY: between the static memory and the stack pointer nothing lives.
        unsafe { (address as *mut u32).write_volatile(PAINT) };
    }
    addr_of!(_stack_start) as usize
}

/// Bytes of the stack that were ever used.
fn high_water(top: usize) -> u32 {
    let bottom = addr_of!(__sheap) as usize;
    // SAFETY: RAM of this machine, read only.
    let clean = (bottom..top).step_by(4).take_while(|address| unsafe { (*address as *const u32).read_volatile() } == PAINT);
    (top - bottom - 4 * clean.count()) as u32
}

/// `SYS_GET_CMDLINE`.
fn read_command_line(buffer: &mut [u8; 80]) -> Option<&str> {
    let block = [buffer.as_mut_ptr() as usize, buffer.len()];
    // SAFETY: the host writes at most as many bytes as the block says, and their number into the block.
    let status = unsafe { cortex_m_semihosting::syscall(0x15, &block) };
    // SAFETY: the compiler has not seen it change.
    let written = unsafe { addr_of!(block[1]).read_volatile() };
    if status != 0 { None } else { core::str::from_utf8(buffer.get(..written)?).ok() }
}

/// The recording and the plan that the command line names.
fn parse(command_line: &str) -> Option<(Replay<'static>, Plan)> {
    let mut words = command_line.trim_end_matches('\0').split(' ');
    let address = usize::from_str_radix(words.next()?, 16).ok()?;
    let plan = Plan::from_name(words.next()?)?;
    // SAFETY: the emulator has put a recording there; the header that it begins with is read before anything is believed.
    let header = Header::read(unsafe { core::slice::from_raw_parts(address as *const u8, HEADER_BYTES) })?;
    // SAFETY: as long as the header says.
    let bytes = unsafe { core::slice::from_raw_parts(address as *const u8, header.total_bytes()?) };
    Some((Replay::new(bytes)?, plan))
}

fn leave(well: bool) -> ! {
    exit(if well { EXIT_SUCCESS } else { EXIT_FAILURE });
    loop {
        cortex_m::asm::nop();
    }
}

#[panic_handler]
fn panicked(_: &PanicInfo<'_>) -> ! {
    if let Ok(stream) = hstdout() {
        Line::new("panic").send(&mut Semihosting(stream));
    }
    leave(false)
}

#[exception]
unsafe fn HardFault(_: &ExceptionFrame) -> ! {
    if let Ok(stream) = hstdout() {
        Line::new("hard fault").send(&mut Semihosting(stream));
    }
    leave(false)
}
