// The extruder board: the real firmware ELF executed by simavr, with the world around it.
//
// Virtual time in nanoseconds since the board's first power-on; it never depends on wall time, so
// the same calls give the same bytes and steps. Bytes travel at 115200 baud, 10 bits each, both
// ways. Pins (firmware/arduino-extruder/board.h): STEP D9, DIR D8, ENABLE D7 (low = on), heater D6,
// servo D10, relay D11, run-permitted (hold) D12, filament sensor D4, thermistor A0, CNC outputs
// A1-A4.
//
// Present limits: no boot loader (the program starts at once after a reset); brown-out is a reset
// with its cause, the supply does not sag; one board per object, not for use from two threads at
// once.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "protocols/result.h"
#include "tools/rig/hot_end.h"

namespace reforge {

enum class BoardReset { kButton, kPowerOn, kBrownOut };  // kButton: DTR as well

// The CNC's outputs as wired to the board for in-stream M-codes; true = relay closed.
enum class CncSignal { kOpenModule, kExtrude, kRetract, kRunning };

struct StepEdge {
  int64_t ns;
  int8_t direction;  // +1 towards the nozzle
};

struct BoardOutputs {
  bool heater_on;  // this instant
  bool motor_enabled;
  bool module_relay;   // true = open
  int servo_pulse_us;  // of the last pulse in the last 40 ms; 0 = the servo is not driven
  bool run_permitted;  // the hold output, energised = the CNC may run
  bool ready;          // to the CNC: no M-code under way, no fault
};

class AvrBoard {
 public:
  static Result<std::unique_ptr<AvrBoard>> open(const std::filesystem::path& elf,
                                                const HotEndProperties& hot_end = {});
  ~AvrBoard();
  AvrBoard(const AvrBoard&) = delete;
  AvrBoard& operator=(const AvrBoard&) = delete;

  // What the EEPROM holds from byte 0 on; read by the firmware when it starts.
  void set_memory(std::span<const uint8_t> bytes);

  int64_t now_ns() const;
  // Runs the firmware up to this time (an instruction's length beyond it at most).
  void advance_to(int64_t ns);

  // Bytes for the board, on the wire from now on, one behind the other.
  void receive(std::span<const uint8_t> bytes);
  int64_t receive_idle_ns() const;  // when the last of them will have arrived
  // Bytes from the board whose stop bit has passed by now.
  std::vector<uint8_t> take_transmitted();
  // When the start bit of the board's latest byte went out.
  int64_t last_transmit_start_ns() const;

  // Everything in the chip starts anew, what is on the wires is lost; EEPROM, hot end and filament
  // stay.
  void reset(BoardReset cause);
  void hang();              // the program loops with interrupts off, as after a stray write
  int resets_seen() const;  // those the board did by itself (watchdog)
  bool crashed() const;     // the firmware executed what no chip would

  BoardOutputs outputs() const;
  // Share of the time since the last call that the heater was on, 0..1.
  double take_heater_duty();
  // Every STEP pulse since the last call, in order; and their signed sum since first power-on.
  std::vector<StepEdge> take_steps();
  int64_t position() const;

  HotEnd& hot_end();  // at now_ns()
  void set_filament_present(bool present);
  void set_signal(CncSignal signal, bool closed);

  // For judging the firmware: lowest free byte count between static data and stack so far, and what
  // the program takes by itself (flash includes the initial values of the data).
  int ram_never_used() const;
  int flash_bytes() const;
  int static_ram_bytes() const;

 private:
  struct Chip;
  explicit AvrBoard(std::unique_ptr<Chip> chip);
  std::unique_ptr<Chip> chip_;
};

}  // namespace reforge
