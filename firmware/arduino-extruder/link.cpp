#include "firmware/arduino-extruder/link.h"

#include "firmware/arduino-extruder/limits.h"

namespace reforge {
namespace firmware {

using wire::Frame;
using wire::Reason;
using wire::Setting;
using wire::Type;

void Link::receive(uint8_t byte, uint32_t now_ms) {
  last_byte_ms_ = now_ms;
  if (!decoder_.push(byte)) {
    // While a host is alive a stray character is noise, not a person.
    const uint32_t patience = static_cast<uint32_t>(settings_.get(Setting::kSilence));
    if (session_ == 0 || now_ms - last_frame_ms_ > patience) terminal_.receive(byte, now_ms);
    return;
  }
  Frame frame;
  while (decoder_.take(frame)) obey(frame, now_ms);
}

void Link::obey(const Frame& frame, uint32_t now_ms) {
  last_frame_ms_ = now_ms;
  wire::Hello hello;
  if (unpack(frame, hello)) greet(hello, frame.sequence, now_ms);
  if (session_ != 0) {
    extruder_.refresh(Authority::kHost, now_ms);
    terminal_.forget();
  }
  wire::GetSetting get;
  switch (frame.type) {
    case Type::kHeartbeat:
      send(pack(wire::Beat{extruder_.state(), extruder_.fault()}, frame.sequence));
      break;
    case Type::kStatusQuery:
      send_status(frame.sequence, now_ms);
      break;
    case Type::kGetSetting:
      if (unpack(frame, get) && static_cast<uint8_t>(get.id) < wire::kSettingCount) {
        send(pack(wire::SettingValue{get.id, settings_.get(get.id)}, frame.sequence));
      } else {
        send(pack(wire::Ack{Reason::kUnknownSetting, extruder_.state()}, frame.sequence));
      }
      break;
    case Type::kCommand:
    case Type::kClearFault:
    case Type::kSetSetting:
    case Type::kSaveSettings:
      order(frame, now_ms);
      break;
    default:
      break;  // a hello, answered above; or what a later host may say: not for us
  }
}

void Link::greet(const wire::Hello& hello, uint8_t sequence, uint32_t now_ms) {
  if (hello.protocol_version != wire::kProtocolVersion || hello.session == 0) {
    send(pack(wire::Ack{Reason::kWrongVersion, extruder_.state()}, sequence));
    return;
  }
  if (hello.session != session_) {
    session_ = hello.session;
    last_ = 0;
    any_order_ = false;
    last_result_ = Reason::kNone;
    // What the former session left under way goes on and its end is nobody's any more; but nobody
    // wants its extrusion, of which an order that was late on the wire may be the cause.
    pending_ = done_due_ = saving_ = false;
    if (extruder_.pushing() && !settings_.get(Setting::kInStream)) {
      extruder_.command(73, wire::kUseSetting, now_ms);
    }
  }
  banner_due_ = false;
  send(pack(banner(session_), sequence));
}

wire::Banner Link::banner(uint16_t session) const {
  return {wire::kProtocolVersion, kVersionMajor, kVersionMinor,     kVersionPatch,    reset_cause_,
          settings_.hash(),       session,       extruder_.state(), extruder_.fault()};
}

void Link::order(const Frame& frame, uint32_t now_ms) {
  if (session_ == 0) {
    send(pack(wire::Ack{Reason::kNoHello, extruder_.state()}, frame.sequence));
    return;
  }
  const int8_t ahead = static_cast<int8_t>(frame.sequence - last_);
  if (any_order_ && ahead == 0) return answer_again(frame);
  if (ahead <= 0) {
    send(pack(wire::Ack{Reason::kStale, extruder_.state()}, frame.sequence));
    return;
  }
  const Reason reason = execute(frame, now_ms);
  last_ = frame.sequence;
  any_order_ = true;
  last_ack_ = reason;
  if (reason != Reason::kNone) {
    last_result_ = reason;
    send(pack(wire::Ack{reason, extruder_.state()}, frame.sequence));
    return;
  }
  if (pending_) conclude(pending_sequence_, Reason::kSuperseded);
  pending_ = true;
  pending_sequence_ = frame.sequence;
  last_result_ = Reason::kPending;
  send(pack(wire::Ack{reason, extruder_.state()}, frame.sequence));
  Reason result;
  if (frame.type == Type::kSetSetting || frame.type == Type::kClearFault) {
    conclude(pending_sequence_, Reason::kNone);
  } else if (extruder_.take_finished(result)) {
    conclude(pending_sequence_, result);
  }
}

Reason Link::execute(const Frame& frame, uint32_t now_ms) {
  wire::Command command;
  const bool m_code = unpack(frame, command);
  const bool stops = m_code && (command.m_code == 71 || command.m_code == 73);
  if (pending_ && (!stops || saving_)) return Reason::kBusy;
  if (m_code) {
    if (settings_.get(Setting::kInStream) && !stops) return Reason::kInStreamOnly;
    return extruder_.command(command.m_code, command.argument, now_ms);
  }
  wire::SetSetting setting;
  if (unpack(frame, setting)) return set(setting);
  if (is(frame, Type::kClearFault, 0)) return extruder_.clear_fault(now_ms);
  if (is(frame, Type::kSaveSettings, 0)) {
    if (!extruder_.idle()) return Reason::kNotIdle;
    store_.begin_save(settings_);
    saving_ = true;
    return Reason::kNone;
  }
  return Reason::kUnknownCommand;
}

Reason Link::set(const wire::SetSetting& message) {
  return extruder_.idle() ? settings_.set(message.id, message.value) : Reason::kNotIdle;
}

void Link::answer_again(const Frame& frame) {
  send(pack(wire::Ack{last_ack_, extruder_.state()}, frame.sequence));
  if (last_ack_ == Reason::kNone && last_result_ != Reason::kPending) {
    send(pack(last_done_, frame.sequence));
  }
}

void Link::conclude(uint8_t sequence, Reason reason) {
  pending_ = false;
  saving_ = false;
  const wire::Done done = {reason, extruder_.state(), extruder_.position()};
  if (sequence == last_) {
    last_result_ = reason;
    last_done_ = done;
  }
  if (!send(pack(done, sequence))) {
    done_due_ = true;
    done_sequence_ = sequence;
    done_ = done;
  }
}

void Link::tick(uint32_t now_ms) {
  if (decoder_.in_frame() && now_ms - last_byte_ms_ >= kFrameGap) {
    decoder_.gap();
    Frame frame;
    while (decoder_.take(frame)) obey(frame, now_ms);
  }
  Reason reason;
  if (!saving_ && extruder_.take_finished(reason)) {
    if (pending_) {
      conclude(pending_sequence_, reason);
    } else if (terminal_.waiting()) {
      terminal_.finished(reason);
    }
  }
  const Store::Progress progress = store_.advance();
  if (saving_ && progress != Store::Progress::kWriting) {
    conclude(pending_sequence_,
             progress == Store::Progress::kSaved ? Reason::kNone : Reason::kSaveFailed);
  }
  if (extruder_.take_fault_report(report_)) report_due_ = true;
  if (banner_due_ && send(pack(banner(0), 0))) banner_due_ = false;
  if (report_due_ && send(pack(report_, 0))) report_due_ = false;
  if (done_due_ && send(pack(done_, done_sequence_))) done_due_ = false;
}

void Link::send_status(uint8_t sequence, uint32_t now_ms) {
  uint8_t flags = 0;
  if (extruder_.filament_present()) flags |= wire::kFlagFilamentPresent;
  if (extruder_.module() == Module::kOpen) flags |= wire::kFlagModuleOpen;
  if (heater_.heating()) flags |= wire::kFlagHeating;
  if (extruder_.run_permitted()) flags |= wire::kFlagRunPermitted;
  send(pack(wire::Status{extruder_.state(), extruder_.fault(), flags, extruder_.temperature(),
                         heater_.target(), extruder_.position(), extruder_.retracted(),
                         extruder_.speed(), last_, last_result_, now_ms},
            sequence));
}

bool Link::send(const Frame& frame) {
  uint8_t bytes[wire::kFrameMax];
  const uint8_t count = encode(frame, bytes);
  if (out_.room() < count) return false;
  for (uint8_t i = 0; i < count; ++i) out_.push(bytes[i]);
  return true;
}

}  // namespace firmware
}  // namespace reforge
