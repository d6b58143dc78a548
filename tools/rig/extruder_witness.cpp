#include "tools/rig/extruder_witness.h"

#include <utility>

#include "protocols/extruder_text.h"
#include "tools/rig/virtual_time.h"

namespace reforge {
namespace {

constexpr int64_t kStandsAfterNs = 50 * kNsPerMs;
constexpr int64_t kRecentNs = 50 * kNsPerMs;
constexpr int64_t kSampleNs = 20 * kNsPerMs;
constexpr int64_t kByteNs = 10 * kNsPerSecond / wire::kBaud;

}  // namespace

std::vector<TraceRecord> ExtruderWitness::take() {
  return std::exchange(records_, {});
}

void ExtruderWitness::record(int64_t ns, const char* event, nlohmann::ordered_json fields) {
  records_.push_back({ns, event, std::move(fields)});
}

void ExtruderWitness::host_sent(std::string_view bytes) {
  wire::Frame frame;
  for (const char byte : bytes) {
    from_host_.push(static_cast<uint8_t>(byte));
    while (from_host_.take(frame)) host_frame(frame);
  }
}

void ExtruderWitness::host_frame(const wire::Frame& frame) {
  wire::Command command{};
  if (wire::unpack(frame, command)) orders_[frame.sequence] = {command.m_code, command.argument};
}

void ExtruderWitness::board_sent(std::string_view bytes, int64_t last_start_ns) {
  wire::Frame frame;
  int64_t start_ns = last_start_ns - (static_cast<int64_t>(bytes.size()) - 1) * kByteNs;
  for (const char byte : bytes) {
    from_board_.push(static_cast<uint8_t>(byte));
    while (from_board_.take(frame)) {
      const int64_t before_last = frame.length + wire::kOverhead - 1;
      board_frame(frame, start_ns - before_last * kByteNs);
    }
    start_ns += kByteNs;
  }
}

void ExtruderWitness::board_frame(const wire::Frame& frame, int64_t ns) {
  wire::Done done{};
  wire::FaultReport fault{};
  if (wire::unpack(frame, done)) {
    const auto order = orders_.find(frame.sequence);
    if (order == orders_.end()) return;
    if (done.reason == wire::Reason::kNone) order_done(order->second, ns);
    orders_.erase(order);
  } else if (wire::unpack(frame, fault)) {
    extrusion_off(ns, "fault");
    record(ns, "fault", {{"who", "extruder"}, {"what", std::string(sentence_of(fault.fault))}});
  }
}

void ExtruderWitness::order_done(const Order& order, int64_t ns) {
  const int64_t steps = position_at(ns);
  switch (order.m_code) {
    case 70:
    case 71:
      if (order.m_code == 71) extrusion_off(ns, "M71");
      record(ns, "module", {{"open", order.m_code == 70}});
      break;
    case 72: {
      extruding_ = true;
      nlohmann::ordered_json fields{{"steps", steps}};
      // An order without argument takes the board's own setting, which the wire does not show.
      if (order.argument != wire::kUseSetting) {
        fields["filament_mm_per_s"] = static_cast<double>(order.argument) / 1000;
      }
      record(ns, "extrude_on", std::move(fields));
      break;
    }
    case 73:
      extrusion_off(ns, "M73");
      break;
    case 74:
      record(ns, "retract", {{"on", true}, {"steps", steps}});
      break;
    case 75:
      record(ns, "retract", {{"on", false}, {"steps", steps}});
      break;
    default:
      break;
  }
}

void ExtruderWitness::extrusion_off(int64_t ns, std::string_view by) {
  if (!std::exchange(extruding_, false)) return;
  record(ns, "extrude_off", {{"steps", position_at(ns)}, {"by", std::string(by)}});
}

void ExtruderWitness::stepped(const std::vector<FilamentStep>& steps) {
  for (const FilamentStep& step : steps) {
    if (step.ns - last_step_ns_ >= kStandsAfterNs) looked_at(step.ns);
    if (moving_ != step.direction) {
      record(step.ns, "steps", {{"steps", position_}, {"moving", step.direction}});
      moving_ = step.direction;
      sampled_ns_ = step.ns;
    }
    position_ += step.direction;
    last_step_ns_ = step.ns;
    recent_.push_back(step);
    while (recent_.front().ns < step.ns - kRecentNs) recent_.pop_front();
  }
}

void ExtruderWitness::looked_at(int64_t ns) {
  if (moving_ == 0) return;
  if (ns - last_step_ns_ < kStandsAfterNs) {
    if (ns - sampled_ns_ < kSampleNs) return;
    sampled_ns_ = ns;
    record(ns, "flow", {{"steps", position_}});
    return;
  }
  moving_ = 0;
  record(last_step_ns_, "steps", {{"steps", position_}, {"moving", 0}});
}

int64_t ExtruderWitness::position_at(int64_t ns) const {
  int64_t at = position_;
  for (auto step = recent_.rbegin(); step != recent_.rend() && step->ns > ns; ++step) {
    at -= step->direction;
  }
  return at;
}

void ExtruderWitness::in_stream_done(int m_code, int64_t ns) {
  order_done({static_cast<uint8_t>(m_code), wire::kUseSetting}, ns);
}

void ExtruderWitness::was_reset(int64_t ns, std::string_view cause) {
  extrusion_off(ns, "reset");
  orders_.clear();
  from_host_ = {};
  from_board_ = {};
  record(ns, "reset", {{"who", "extruder"}, {"cause", std::string(cause)}});
}

}  // namespace reforge
