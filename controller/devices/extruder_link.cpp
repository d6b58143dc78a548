#include "controller/devices/extruder_link.h"

#include <algorithm>
#include <cassert>
#include <utility>

#include "controller/devices/extruder_agreement.h"
#include "protocols/extruder_text.h"

namespace reforge {

namespace {

constexpr Duration kFrameGap = std::chrono::milliseconds(20);  // FORMATS.md, "Extruder link"

bool pushes(wire::State state) {
  return state == wire::State::kExtruding || state == wire::State::kRestoring ||
         state == wire::State::kStopping;
}

}  // namespace

ExtruderLink::ExtruderLink(const RigDescription& rig, ExtruderTimes times,
                           std::uint16_t session_seed)
    : rig_(rig), times_(times), session_(session_seed) {}

void ExtruderLink::opened(Instant now) {
  closed();
  open_ = true;
  decoder_ = {};
  // A new session for every opening: what an earlier one left on its way is stale.
  if (++session_ == 0) session_ = 1;
  sequence_ = 0;
  setting_ = 0;
  hellos_ = 0;
  if (now < quiet_until_) {
    next_beat_ = quiet_until_;
  } else {
    beat(now);
  }
}

void ExtruderLink::closed() {
  open_ = lost_ = greeted_ = identified_ = starving_ = fault_reported_ = wants_extrusion_ = false;
  outstanding_.reset();
  queue_.clear();
  status_.reset();
  next_beat_ = kNever;
  output_.clear();
}

std::vector<ExtruderLink::Event> ExtruderLink::receive(Instant now, std::string_view bytes) {
  Events out;
  wire::Frame frame;
  if (decoder_.in_frame() && now - last_byte_ >= kFrameGap) {
    decoder_.gap();
    while (decoder_.take(frame)) take(now, frame, out);
  }
  last_byte_ = now;
  for (const char c : bytes) {
    decoder_.push(static_cast<std::uint8_t>(c));
    while (decoder_.take(frame)) take(now, frame, out);
  }
  return out;
}

void ExtruderLink::take(Instant now, const wire::Frame& frame, Events& out) {
  if (!open_ || lost_) return;
  last_frame_ = now;
  wire::Banner banner;
  wire::Beat answer;
  wire::Status status;
  wire::SettingValue value;
  wire::Done done;
  wire::FaultReport fault;
  if (unpack(frame, banner)) {
    take_banner(now, banner, out);
  } else if (!greeted_) {
    wire::Ack ack;
    if (unpack(frame, ack) && ack.reason == wire::Reason::kWrongVersion) {
      reject("The extruder board does not speak version " + std::to_string(wire::kProtocolVersion) +
                 " of the link: load the firmware that belongs to this daemon.",
             out);
    }
  } else if (unpack(frame, status)) {
    take_status(now, status, out);
  } else if (unpack(frame, value)) {
    if (frame.sequence == query_) take_setting(now, value, out);
  } else if (unpack(frame, answer)) {
    judge_fault(answer.state, answer.fault, out);
  } else if (unpack(frame, fault)) {
    judge_fault(wire::State::kFault, fault.fault, out);
  } else if (frame.type == wire::Type::kAck) {
    take_ack(now, frame, out);
  } else if (unpack(frame, done)) {
    if (outstanding_ && outstanding_->frame.sequence == frame.sequence) {
      if (status_) status_->state = done.state;
      finish(now, done.reason, out);
    }
  }
}

void ExtruderLink::take_banner(Instant now, const wire::Banner& banner, Events& out) {
  if (banner.protocol_version != wire::kProtocolVersion) {
    reject("The extruder board speaks version " + std::to_string(banner.protocol_version) +
               " of the link, the daemon " + std::to_string(wire::kProtocolVersion) +
               ": load the firmware that belongs to it.",
           out);
    return;
  }
  version_ = std::to_string(banner.version_major) + "." + std::to_string(banner.version_minor) +
             "." + std::to_string(banner.version_patch);
  if (banner.session == session_) {
    if (greeted_) return;  // a repeated hello
    greeted_ = true;
    hellos_ = 0;
    beat(now);
    send_next(now);
    return;
  }
  if (greeted_) {
    out.push_back(Fault{"The extruder board has reset by itself (" +
                        std::string(reset_cause_text(banner.reset_cause)) +
                        "): heater and extrusion are off."});
    opened(now);
  } else if (banner.session == 0) {
    beat(now);  // it has just come up: greet it at once
  }
}

void ExtruderLink::take_setting(Instant now, const wire::SettingValue& value, Events& out) {
  if (setting_ >= agreements().size() || outstanding_) return;
  const Agreement& agreement = agreements()[setting_];
  if (value.id != agreement.id) return;
  if (value.id == wire::Setting::kSilence) {
    dead_man_ = std::chrono::milliseconds(std::clamp(value.value, 100, 60000));
  }
  const auto want = wanted_value(value.id, rig_);
  if (!want || *want == value.value) {
    ++setting_;
    beat(now);
  } else if (agreement.writable) {
    outstanding_ = Outstanding{pack(wire::SetSetting{value.id, *want}, ++sequence_), {}};
    send_outstanding(now);
  } else {
    reject("The extruder board's setting " + std::string(name_of(value.id)) + " is " +
               std::to_string(value.value) + ", the rig file needs " + std::to_string(*want) + ".",
           out);
  }
}

void ExtruderLink::take_status(Instant now, const wire::Status& status, Events& out) {
  status_ = status;
  judge_fault(status.state, status.fault, out);
  if (!identified_ && setting_ == agreements().size()) {
    identified_ = true;
    out.push_back(Identified{version_});
  }
  if (outstanding_ && outstanding_->attempts > 0 &&
      status.last_sequence == outstanding_->frame.sequence &&
      status.last_result != wire::Reason::kPending) {
    finish(now, status.last_result, out);  // its kDone was lost
  }
}

void ExtruderLink::take_ack(Instant now, const wire::Frame& frame, Events& out) {
  wire::Ack ack;
  if (!unpack(frame, ack)) return;
  if (outstanding_ && outstanding_->frame.sequence == frame.sequence) {
    if (status_) status_->state = ack.state;
    if (ack.reason != wire::Reason::kNone) return finish(now, ack.reason, out);
    outstanding_->acknowledged = true;
    outstanding_->resend_at = kNever;
  } else if (!identified_ && frame.sequence == query_ &&
             ack.reason == wire::Reason::kUnknownSetting) {
    reject(
        "The extruder board does not know a setting the rig file needs: load the firmware that "
        "belongs to this daemon.",
        out);
  }
}

void ExtruderLink::finish(Instant now, wire::Reason reason, Events& out) {
  if (reason == wire::Reason::kStale) {
    return lose(now, "The extruder board counts orders of another session.", out);
  }
  const Outstanding over = *std::exchange(outstanding_, std::nullopt);
  const bool done = reason == wire::Reason::kNone;
  const std::string why(sentence_of(reason));
  if (over.order) {
    if (done) {
      out.push_back(Done{*over.order});
    } else if (reason != wire::Reason::kSuperseded) {
      out.push_back(
          Refused{*over.order, "The extruder did not do " + to_string(*over.order) + ": " + why});
    }
  } else if (over.frame.type == wire::Type::kClearFault) {
    if (done) {
      fault_reported_ = false;
      if (status_) status_->fault = wire::Fault::kNone;
    } else {
      out.push_back(Fault{"The extruder's fault could not be cleared: " + why});
    }
    beat(now);  // its state has changed
  } else if (done) {
    ++setting_;
    beat(now);
  } else {
    return reject(
        "The extruder board's settings differ from the rig file and it did not take new "
        "ones: " +
            why,
        out);
  }
  send_next(now);
}

void ExtruderLink::judge_fault(wire::State state, wire::Fault fault, Events& out) {
  const bool faulty = state == wire::State::kFault || fault != wire::Fault::kNone;
  if (!faulty || fault_reported_) return;
  fault_reported_ = true;
  out.push_back(Fault{"Extruder fault: " + std::string(sentence_of(fault))});
}

void ExtruderLink::reject(std::string sentence, Events& out) {
  closed();  // until the port is opened again
  out.push_back(WrongBoard{std::move(sentence)});
}

// Sends on when told to (an M73 may still get through), but asks and judges nothing any more. The
// board is greeted again only after its dead-man had its time: greeting it would feed it.
void ExtruderLink::lose(Instant now, std::string sentence, Events& out) {
  lost_ = true;
  quiet_until_ = now + dead_man_ + times_.dead_man_margin;
  identified_ = starving_ = false;
  outstanding_.reset();
  queue_.clear();
  next_beat_ = kNever;
  out.push_back(Lost{std::move(sentence)});
}

void ExtruderLink::order(Instant now, const ExtruderOrder& order) {
  if (order.m_code == 72) closer_since_ = now;
  wants_extrusion_ = order.m_code == 72;
  if (wants_extrusion_) next_beat_ = earlier(next_beat_, now + times_.heartbeat_extruding);
  Outstanding next{
      pack(wire::Command{static_cast<std::uint8_t>(order.m_code), wire_argument(order)}, 0), order};
  const bool overtakes = order.m_code == 71 || order.m_code == 73;
  if (overtakes) {
    const auto under_way = [&](int m_code) {
      return (outstanding_ && outstanding_->is(m_code)) ||
             std::any_of(queue_.begin(), queue_.end(),
                         [&](const Outstanding& o) { return o.is(m_code); });
    };
    if (under_way(order.m_code) || (order.m_code == 73 && under_way(71))) return;
    std::erase_if(queue_, [](const Outstanding& o) { return o.order && !o.is(73); });
    if (outstanding_ && outstanding_->order && !outstanding_->is(73)) outstanding_.reset();
  }
  enqueue(now, std::move(next));
}

void ExtruderLink::clear_fault(Instant now) {
  starving_ = false;
  enqueue(now, Outstanding{pack(wire::Type::kClearFault, 0), {}});
}

void ExtruderLink::starve(Instant now) {
  if (!open_ || lost_) return;
  starving_ = true;
  last_sent_ = now;
}

bool ExtruderLink::busy() const {
  return outstanding_ || !queue_.empty();
}

bool ExtruderLink::warm() const {
  if (!identified()) return false;
  return status_->state != wire::State::kClosed && status_->state != wire::State::kClosing &&
         status_->state != wire::State::kStandby && status_->state != wire::State::kFault;
}

bool ExtruderLink::extruding() const {
  return wants_extrusion_ || (status_ && pushes(status_->state));
}

void ExtruderLink::enqueue(Instant now, Outstanding next) {
  if (!open_) return;
  queue_.push_back(std::move(next));
  send_next(now);
}

void ExtruderLink::send_next(Instant now) {
  if (outstanding_ || queue_.empty() || !greeted_) return;
  outstanding_ = std::move(queue_.front());
  queue_.pop_front();
  outstanding_->frame.sequence = ++sequence_;
  send_outstanding(now);
}

void ExtruderLink::send_outstanding(Instant now) {
  if (outstanding_->attempts++ == 0) {
    outstanding_->give_up_at = now + (outstanding_->is(70) ? times_.heat_up : times_.finish);
  }
  outstanding_->resend_at = now + times_.acknowledge;
  transmit(now, outstanding_->frame);
}

void ExtruderLink::transmit(Instant now, const wire::Frame& frame) {
  std::uint8_t bytes[wire::kFrameMax];
  const std::uint8_t size = encode(frame, bytes);
  output_.append(reinterpret_cast<const char*>(bytes), size);
  last_sent_ = now;
}

void ExtruderLink::beat(Instant now) {
  ++query_;
  if (!greeted_) {
    transmit(now, pack(wire::Hello{wire::kProtocolVersion, session_}, query_));
  } else if (setting_ < agreements().size() && !outstanding_) {
    transmit(now, pack(wire::GetSetting{agreements()[setting_].id}, query_));
  } else {
    transmit(now, pack(wire::Type::kStatusQuery, query_));
  }
  if (!greeted_ && ++hellos_ >= times_.hellos) {
    hellos_ = 0;
    next_beat_ = now + dead_man_ + times_.dead_man_margin;
    return;
  }
  const bool patient = !greeted_ || !identified_;
  next_beat_ = now + (patient       ? times_.hello
                      : extruding() ? times_.heartbeat_extruding
                                    : times_.heartbeat);
}

std::vector<ExtruderLink::Event> ExtruderLink::tick(Instant now) {
  Events out;
  if (!open_ || lost_) return out;
  if (decoder_.in_frame() && now - last_byte_ >= kFrameGap) {
    wire::Frame frame;
    decoder_.gap();
    while (decoder_.take(frame)) take(now, frame, out);
    last_byte_ = now;
  }
  if (outstanding_ && now >= outstanding_->resend_at) {
    if (outstanding_->attempts >= times_.attempts) {
      const std::string what =
          outstanding_->order ? to_string(*outstanding_->order) : std::string("a setting");
      lose(now, "The extruder board has not acknowledged " + what + ".", out);
      return out;
    }
    send_outstanding(now);
  }
  if (outstanding_ && outstanding_->order && now >= outstanding_->give_up_at) {
    const ExtruderOrder order = *outstanding_->order;
    outstanding_.reset();
    out.push_back(Refused{
        order, "The extruder has not come to the end of " + to_string(order) + " in its time."});
    send_next(now);
  }
  if (now >= silent_at()) {
    lose(now, "The extruder board is silent.", out);
    return out;
  }
  if (starving_ && now >= starved_at()) {
    starving_ = false;
    last_frame_ = next_beat_ = now;  // silence was ours
    status_.reset();                 // of before
  }
  if (!starving_ && now >= next_beat_) beat(now);
  return out;
}

// An order that is sent while starving feeds the board once more.
Instant ExtruderLink::starved_at() const {
  return last_sent_ + dead_man_ + times_.dead_man_margin;
}

Instant ExtruderLink::silent_at() const {
  if (!greeted_ || starving_) return kNever;
  if (extruding()) return std::max(last_frame_, closer_since_) + times_.silence_extruding;
  return last_frame_ + times_.silence;
}

Instant ExtruderLink::next_deadline() const {
  if (!open_ || lost_) return kNever;
  Instant next = silent_at();
  next = earlier(next, starving_ ? starved_at() : next_beat_);
  if (outstanding_) {
    next = earlier(next, earlier(outstanding_->resend_at, outstanding_->give_up_at));
  }
  if (decoder_.in_frame()) next = earlier(next, last_byte_ + kFrameGap);
  return next;
}

std::string ExtruderLink::take_output() {
  return std::exchange(output_, {});
}

}  // namespace reforge
