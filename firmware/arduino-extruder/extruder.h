// M70-M75: the extruder's state machine, its dead-man and its one fault path.
//
// command() says at once whether an order is taken; take_finished() says when it came to its end.
// tick() runs every millisecond. Nothing here touches a pin: the main loop carries Outputs to the
// board. Invariants: filament moves only in kRestoring, kExtruding, kStopping, kRetracting (and the
// first moment of kClosing); in kFault, kClosed and kStandby the heater is off; M72 and M74 are
// never on together. A fault stops the motor without a ramp, switches heat off and drops the run
// permission; the module stays where it is, since moving a hot nozzle beside a part is no safe act.
#pragma once

#include <stdint.h>

#include "firmware/arduino-extruder/feeder.h"
#include "firmware/arduino-extruder/heater.h"
#include "firmware/arduino-extruder/settings.h"
#include "protocols/extruder_wire.h"

namespace reforge {
namespace firmware {

enum class Module : uint8_t { kLimp, kClosed, kOpen };  // limp: not driven since the reset

// Who speaks last decides which silence counts.
enum class Authority : uint8_t { kNobody, kHost, kTerminal, kInStream };

class Extruder {
 public:
  Extruder(const Settings& settings, Feeder& feeder, Heater& heater)
      : settings_(settings), feeder_(feeder), heater_(heater) {}

  // An order: kNone when taken, otherwise why not (nothing has changed then). An order still under
  // way when M71, M73 or M75 is taken counts as superseded; take_finished() then speaks of the new
  // one.
  wire::Reason command(uint8_t m_code, int32_t argument, uint32_t now_ms);
  // M72 that ends by itself after `um`; it is finished when the length is out.
  wire::Reason extrude_length(int32_t um, int32_t um_per_s);
  // Refused while the cause is still there. The module's state is kept: kStandby when it is open.
  wire::Reason clear_fault(uint32_t now_ms);
  bool under_way() const { return under_way_; }
  bool take_finished(wire::Reason& reason);

  // A sign of life.
  void refresh(Authority authority, uint32_t now_ms);
  void tick(bool filament_present, uint32_t now_ms);
  void fault(wire::Fault fault);
  // True once after a fault has latched.
  bool take_fault_report(wire::FaultReport& report);

  wire::State state() const { return state_; }
  wire::Fault fault() const { return fault_; }
  bool idle() const;  // settings may change
  bool pushing() const {
    return state_ == wire::State::kRestoring || state_ == wire::State::kExtruding;
  }
  Module module() const { return module_; }
  bool run_permitted() const { return run_permitted_; }
  bool filament_present() const { return filament_present_; }
  int32_t position() const { return feeder_.position(); }
  int32_t retracted() const {
    const int32_t behind = front_ - feeder_.position();
    return behind > 0 ? behind : 0;  // ahead of it until the next tick
  }
  int32_t speed() const { return state_ == wire::State::kExtruding ? speed_ : 0; }
  int16_t temperature() const;

 private:
  wire::Reason permitted(uint8_t m_code) const;
  wire::Reason open(int32_t target, uint32_t now_ms);
  wire::Reason close(uint32_t now_ms);
  wire::Reason extrude(int32_t um, int32_t um_per_s);
  wire::Reason retract(int32_t um);
  void stop();
  void begin_extruding();
  wire::Reason filament_ready() const;
  void prepare_motion();
  bool filament_moves() const;
  void enter(wire::State state, bool order_under_way);
  void finish(wire::Reason reason);
  void advance(uint32_t now_ms);
  void watch(uint32_t now_ms);

  const Settings& settings_;
  Feeder& feeder_;
  Heater& heater_;

  wire::State state_ = wire::State::kClosed;
  wire::Fault fault_ = wire::Fault::kNone;
  Module module_ = Module::kLimp;
  bool under_way_ = false;
  bool finished_ = false;
  wire::Reason finished_reason_ = wire::Reason::kNone;

  uint32_t since_ms_ = 0;    // opening or closing began
  bool retreating_ = false;  // closing: the motor is at rest and the module on its way
  int32_t front_ = 0;        // foremost position of the filament: where it was before retraction
  int32_t speed_ = 0;        // um/s of M72
  uint32_t rate_q8_ = 0;     // the same in steps
  uint32_t retract_rate_q8_ = 0;
  int32_t length_steps_ = 0;  // of M72 with a length; 0: until M73
  bool filament_present_ = true;

  Authority authority_ = Authority::kNobody;
  uint32_t refreshed_ms_ = 0;
  bool run_permitted_ = false;

  bool report_due_ = false;
  wire::FaultReport report_ = {};
};

}  // namespace firmware
}  // namespace reforge
