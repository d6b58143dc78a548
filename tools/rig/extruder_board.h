// The extruder board as the virtual rig sees it: firmware behind a serial line, a motor, an output
// that permits the CNC to run. AvrExtruder is the real firmware; tests bring their own.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tools/rig/cnc_controller.h"

namespace reforge {

// A pulse on the STEP pin.
struct FilamentStep {
  int64_t ns;
  int direction;  // +1 towards the nozzle
};

// What may happen to the board and what hangs on it.
enum class BoardMishap {
  kReset,  // its button
  kBrownOut,
  kPowerCycle,
  kHang,  // the program loops with interrupts off
  kSensorConnected,
  kSensorOpen,
  kSensorShort,
  kSensorFallenOut,
  kHeaterBroken,
  kFilamentOut,
  kFilamentIn,
};

class ExtruderBoard {
 public:
  virtual ~ExtruderBoard() = default;

  virtual void advance_to(int64_t ns) = 0;
  // Bytes on the wire from now on; the board's line paces them itself.
  virtual void receive(std::string_view bytes) = 0;
  // Bytes whose stop bit has passed by now.
  virtual std::string take_transmitted() = 0;
  virtual int64_t last_transmit_start_ns() const = 0;  // start bit of the latest byte

  virtual void reset() = 0;                  // as DTR does
  virtual int resets_by_itself() const = 0;  // watchdog, so far
  virtual bool crashed() const = 0;
  virtual void suffer(BoardMishap mishap) = 0;

  virtual std::vector<FilamentStep> take_steps() = 0;
  virtual bool run_permitted() const = 0;
  virtual bool module_open() const = 0;
  virtual bool ready() const = 0;  // to the CNC: no M-code under way, no fault
  virtual void set_cnc_outputs(const CncOutputs& outputs) = 0;  // the CNC's relays, in-stream
  virtual double nozzle_c() = 0;
};

}  // namespace reforge
