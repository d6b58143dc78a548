#include "firmware/arduino-extruder/extruder.h"

#include "firmware/arduino-extruder/flash.h"
#include "firmware/arduino-extruder/limits.h"

namespace reforge {
namespace firmware {
namespace {

using wire::Fault;
using wire::Reason;
using wire::Setting;
using wire::State;

// What each state says to M70..M75; kNone: taken, if temperature, filament and argument allow.
constexpr uint8_t kOk = static_cast<uint8_t>(Reason::kNone);
constexpr uint8_t kNop = kOk;  // taken and done at once, nothing changes
constexpr uint8_t kBusy = static_cast<uint8_t>(Reason::kBusy);
constexpr uint8_t kShut = static_cast<uint8_t>(Reason::kNotOpen);
constexpr uint8_t kExtr = static_cast<uint8_t>(Reason::kExtrusionOn);
constexpr uint8_t kRetr = static_cast<uint8_t>(Reason::kRetractionOn);
constexpr uint8_t kFlt = static_cast<uint8_t>(Reason::kFaultLatched);

constexpr uint8_t kTable[wire::kStateCount][6] REFORGE_FLASH = {
    // M70   M71   M72    M73   M74    M75
    {kOk, kOk, kShut, kNop, kShut, kNop},    // kClosed
    {kBusy, kOk, kShut, kOk, kShut, kShut},  // kOpening
    {kOk, kOk, kOk, kNop, kOk, kNop},        // kReady
    {kExtr, kOk, kExtr, kOk, kExtr, kExtr},  // kRestoring
    {kExtr, kOk, kExtr, kOk, kExtr, kNop},   // kExtruding
    {kBusy, kOk, kBusy, kOk, kBusy, kBusy},  // kStopping
    {kRetr, kOk, kRetr, kOk, kBusy, kOk},    // kRetracting
    {kBusy, kOk, kShut, kOk, kShut, kShut},  // kClosing
    {kOk, kOk, kShut, kNop, kShut, kNop},    // kStandby
    {kFlt, kFlt, kFlt, kFlt, kFlt, kFlt},    // kFault
    {kRetr, kOk, kRetr, kNop, kOk, kOk},     // kRetracted
};
static_assert(static_cast<uint8_t>(State::kRetracted) + 1 == wire::kStateCount, "a row per state");

}  // namespace

Reason Extruder::permitted(uint8_t m_code) const {
  if (m_code < 70 || m_code > 75) return Reason::kUnknownCommand;
  return static_cast<Reason>(flash_u8(&kTable[static_cast<uint8_t>(state_)][m_code - 70]));
}

Reason Extruder::command(uint8_t m_code, int32_t argument, uint32_t now_ms) {
  const Reason refusal = permitted(m_code);
  if (refusal != Reason::kNone) return refusal;
  switch (m_code) {
    case 70:
      return open(argument, now_ms);
    case 71:
      return close(now_ms);
    case 72:
      return extrude(0, argument);
    case 74:
      return retract(argument);
    default:
      break;
  }
  if (m_code == 75 && state_ == State::kRetracted) {
    enter(State::kReady, false);
  } else if (m_code == 73 || state_ == State::kRetracting) {
    stop();
  } else {
    finish(Reason::kNone);
  }
  return Reason::kNone;
}

Reason Extruder::extrude_length(int32_t um, int32_t um_per_s) {
  const Reason refusal = permitted(72);
  if (refusal != Reason::kNone) return refusal;
  return um > 0 && settings_.steps(um) > 0 ? extrude(um, um_per_s) : Reason::kBadArgument;
}

Reason Extruder::open(int32_t target, uint32_t now_ms) {
  if (heater_.fitted()) {
    if (target == wire::kUseSetting) target = settings_.get(Setting::kTargetTemperature);
    if (target < settings_.get(Setting::kMinimumTemperature) ||
        target > settings_.get(Setting::kMaximumTemperature) - kTargetMargin) {
      return Reason::kBadArgument;
    }
    heater_.set_target(static_cast<int16_t>(target), now_ms);
  }
  // An open module is asked to open again without waiting for its travel.
  since_ms_ = module_ == Module::kOpen
                  ? now_ms - static_cast<uint32_t>(settings_.get(Setting::kModuleTravel))
                  : now_ms;
  module_ = Module::kOpen;
  prepare_motion();
  enter(State::kOpening, true);
  return Reason::kNone;
}

// What the settings say about motion, once per M70: they cannot change while the module is open.
void Extruder::prepare_motion() {
  // Settings::steps takes 200,000 at most, the acceleration may be ten times that.
  const int32_t tenth = settings_.steps(settings_.get(Setting::kAcceleration) / 10);
  feeder_.set_acceleration(static_cast<uint32_t>(tenth) * 10);
  retract_rate_q8_ = settings_.rate_q8(settings_.get(Setting::kRetractSpeed));
  if (retract_rate_q8_ > kStepRateMax * 256) retract_rate_q8_ = kStepRateMax * 256;
  if (retract_rate_q8_ < kRateQ8Min) retract_rate_q8_ = kRateQ8Min;
}

Reason Extruder::close(uint32_t now_ms) {
  heater_.off();
  if (state_ != State::kClosing) {
    feeder_.stop();
    retreating_ = false;
    since_ms_ = now_ms;
  }
  enter(State::kClosing, true);
  return Reason::kNone;
}

Reason Extruder::filament_ready() const {
  if (!heater_.warm(0)) return Reason::kTooCold;
  return filament_present_ ? Reason::kNone : Reason::kNoFilament;
}

Reason Extruder::extrude(int32_t um, int32_t um_per_s) {
  if (um_per_s == wire::kUseSetting) um_per_s = settings_.get(Setting::kFilamentSpeed);
  if (um_per_s < 0 || um_per_s > kSpeedMax) return Reason::kBadArgument;
  const uint32_t rate_q8 = settings_.rate_q8(um_per_s);
  if (rate_q8 < kRateQ8Min || rate_q8 > kStepRateMax * 256) return Reason::kBadArgument;
  if (um > kLengthMax) return Reason::kBadArgument;
  const Reason refusal = filament_ready();
  if (refusal != Reason::kNone) return refusal;

  speed_ = um_per_s;
  rate_q8_ = rate_q8;
  length_steps_ = um > 0 ? settings_.steps(um) : 0;
  if (retracted() > 0) {
    feeder_.move(retracted(), retract_rate_q8_);
    enter(State::kRestoring, true);
  } else {
    begin_extruding();
  }
  return Reason::kNone;
}

void Extruder::begin_extruding() {
  if (length_steps_ > 0) {
    feeder_.move(length_steps_, rate_q8_);
    enter(State::kExtruding, true);
  } else {
    feeder_.run(rate_q8_);
    enter(State::kExtruding, false);
  }
}

Reason Extruder::retract(int32_t um) {
  if (um == wire::kUseSetting) um = settings_.get(Setting::kRetractLength);
  if (um < 0 || um > kRetractMax) return Reason::kBadArgument;
  const Reason refusal = filament_ready();
  if (refusal != Reason::kNone) return refusal;

  const int32_t further = settings_.steps(um) - retracted();
  if (further > 0) {
    feeder_.move(-further, retract_rate_q8_);
    enter(State::kRetracting, true);
  } else {
    enter(State::kRetracted, false);
  }
  return Reason::kNone;
}

// M73, and M75 while M74 still moves.
void Extruder::stop() {
  if (state_ == State::kOpening) {
    heater_.off();
    enter(State::kStandby, false);
  } else if (filament_moves()) {
    feeder_.stop();
    enter(State::kStopping, true);
  } else if (state_ == State::kClosing) {
    under_way_ = true;  // ends with the closing
  } else {
    finish(Reason::kNone);
  }
}

bool Extruder::filament_moves() const {
  return state_ == State::kRestoring || state_ == State::kExtruding || state_ == State::kStopping ||
         state_ == State::kRetracting;
}

void Extruder::enter(State state, bool order_under_way) {
  state_ = state;
  if (order_under_way) {
    under_way_ = true;
    finished_ = false;
  } else {
    finish(Reason::kNone);
  }
}

void Extruder::finish(Reason reason) {
  under_way_ = false;
  finished_ = true;
  finished_reason_ = reason;
}

bool Extruder::take_finished(Reason& reason) {
  if (!finished_) return false;
  finished_ = false;
  reason = finished_reason_;
  return true;
}

void Extruder::refresh(Authority authority, uint32_t now_ms) {
  authority_ = authority;
  refreshed_ms_ = now_ms;
}

void Extruder::tick(bool filament_present, uint32_t now_ms) {
  filament_present_ = filament_present || settings_.get(Setting::kFilamentSensor) == 0;
  feeder_.tick();
  const int32_t position = feeder_.position();
  if (position > front_) front_ = position;
  if (state_ != State::kFault) watch(now_ms);
  if (state_ != State::kFault) advance(now_ms);
}

// Whatever ends heat and motion whether an order is under way or not.
void Extruder::watch(uint32_t now_ms) {
  const Fault heat = heater_.check(now_ms);
  if (heat != Fault::kNone) return fault(heat);

  const uint32_t silence = now_ms - refreshed_ms_;
  const bool at_terminal = authority_ == Authority::kTerminal;
  const uint32_t patience =
      static_cast<uint32_t>(settings_.get(at_terminal ? Setting::kTextSilence : Setting::kSilence));
  const bool alive = authority_ != Authority::kNobody && silence <= patience;
  run_permitted_ = alive;

  if (filament_moves()) {
    // A person at a terminal extrudes counted lengths, which end by themselves.
    const bool counted = at_terminal && length_steps_ > 0;
    if (!counted && silence > static_cast<uint32_t>(settings_.get(Setting::kExtrusionSilence))) {
      return fault(Fault::kExtrusionSilence);
    }
    if (!filament_present_ && state_ == State::kExtruding) return fault(Fault::kFilamentOut);
    // An unknown temperature is the heater's to judge, within three of its windows.
    if (temperature() != wire::kTemperatureUnknown && !heater_.warm(kColdMargin)) {
      return fault(Fault::kRunaway);
    }
  }
  if (!alive && (heater_.heating() || module_ == Module::kOpen) && state_ != State::kStandby) {
    fault(Fault::kSilence);
  }
}

// Orders that have come to their end.
void Extruder::advance(uint32_t now_ms) {
  const uint32_t travel = static_cast<uint32_t>(settings_.get(Setting::kModuleTravel));
  switch (state_) {
    case State::kOpening:
      if (now_ms - since_ms_ >= travel && (!heater_.fitted() || heater_.at_target())) {
        enter(State::kReady, false);
      } else if (now_ms - since_ms_ >
                 static_cast<uint32_t>(settings_.get(Setting::kHeatUpTime)) + travel) {
        fault(Fault::kHeaterTimeout);
      }
      break;
    case State::kRestoring:
      if (!feeder_.moving()) begin_extruding();
      break;
    case State::kExtruding:  // without a length it moves until told otherwise
    case State::kStopping:
      if (!feeder_.moving()) enter(State::kReady, false);
      break;
    case State::kRetracting:
      if (!feeder_.moving()) enter(State::kRetracted, false);
      break;
    case State::kClosing:
      if (!retreating_ && !feeder_.moving()) {
        retreating_ = true;
        module_ = Module::kClosed;
        since_ms_ = now_ms;
      }
      if (retreating_ && now_ms - since_ms_ >= travel) enter(State::kClosed, false);
      break;
    default:  // nothing is under way
      break;
  }
}

void Extruder::fault(Fault fault) {
  if (state_ == State::kFault) return;
  feeder_.halt();
  heater_.off();
  run_permitted_ = false;
  report_ = {fault, state_, temperature(), feeder_.position()};
  report_due_ = true;
  fault_ = fault;
  state_ = State::kFault;
  if (under_way_) finish(Reason::kFaulted);
}

bool Extruder::take_fault_report(wire::FaultReport& report) {
  if (!report_due_) return false;
  report_due_ = false;
  report = report_;
  return true;
}

Reason Extruder::clear_fault(uint32_t now_ms) {
  if (state_ == State::kFault) {
    const bool sensor = fault_ == Fault::kSensorOpen || fault_ == Fault::kSensorShort;
    if (heater_.check(now_ms) != Fault::kNone ||
        (sensor && heater_.fitted() && temperature() == wire::kTemperatureUnknown)) {
      return Reason::kFaultPersists;
    }
    fault_ = Fault::kNone;
    state_ = module_ == Module::kOpen ? State::kStandby : State::kClosed;
  }
  return Reason::kNone;
}

bool Extruder::idle() const {
  return state_ == State::kClosed || state_ == State::kStandby || state_ == State::kFault;
}

int16_t Extruder::temperature() const {
  return heater_.fitted() ? heater_.temperature() : wire::kTemperatureUnknown;
}

}  // namespace firmware
}  // namespace reforge
