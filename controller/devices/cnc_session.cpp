#include "controller/devices/cnc_session.h"

#include <cassert>
#include <utility>

namespace reforge {

namespace {

std::string request(const CncDevice& device, CncSession::Question question) {
  switch (question) {
    case CncSession::Question::kIdentity:
      return device.identify();
    case CncSession::Question::kOffsets:
      return device.ask_offsets();
    case CncSession::Question::kUnlock:
      return device.unlock();
    case CncSession::Question::kNone:
      break;
  }
  return {};
}

}  // namespace

CncSession::CncSession(std::unique_ptr<CncDevice> device, CncTimes times)
    : device_(std::move(device)), times_(times) {}

void CncSession::opened(Instant now) {
  device_->forget();
  facts_ = {};
  question_ = Question::kNone;
  question_until_ = silent_at_ = kNever;
  has_spoken_ = false;
  query_status(now);
}

void CncSession::closed() {
  question_ = Question::kNone;
  question_until_ = next_poll_ = silent_at_ = kNever;
  facts_.status.reset();
  output_.clear();
}

void CncSession::reset_sent(Instant now) {
  question_ = Question::kNone;
  question_until_ = kNever;
  // Queries in the receiver are lost with it, and the controller restarts: silence counts from
  // here.
  silent_at_ = kNever;
  has_spoken_ = false;
  output_.clear();
  facts_.status.reset();
  next_poll_ = now + times_.status_period;
}

void CncSession::ask(Instant now, Question question) {
  assert(question_ == Question::kNone && question != Question::kNone);
  question_ = question;
  question_until_ = now + times_.question;
  if (question == Question::kOffsets) facts_.g54.reset();
  if (question == Question::kIdentity) facts_.axes.clear();
  output_ += request(*device_, question);
}

void CncSession::query_status(Instant now) {
  output_ += device_->status_query();
  next_poll_ = now + (closely_ ? times_.status_period : times_.idle_status_period);
  if (has_spoken_ && silent_at_ == kNever) silent_at_ = now + times_.silence;
}

void CncSession::watch_closely(Instant now, bool closely) {
  if (closely && !closely_ && next_poll_ != kNever) {
    next_poll_ = earlier(next_poll_, now + times_.status_period);
  }
  closely_ = closely;
}

std::vector<CncSession::Event> CncSession::receive(Instant now, std::string_view bytes) {
  std::vector<Event> out;
  for (const CncReport& event : device_->receive(bytes)) note(now, event, out);
  return out;
}

void CncSession::note(Instant now, const CncReport& event, std::vector<Event>& out) {
  const auto answered = [&](std::string error) {
    out.push_back(Answered{question_, std::move(error)});
    if (question_ == Question::kUnlock) {
      facts_.status.reset();  // of before
      query_status(now);
    }
    question_ = Question::kNone;
    question_until_ = kNever;
  };
  if (const auto* status = std::get_if<CncStatus>(&event)) {
    facts_.status = *status;
    facts_.status_at = now;
    silent_at_ = kNever;
    has_spoken_ = true;
  } else if (const auto* identity = std::get_if<cnc::Identity>(&event)) {
    if (!identity->version.empty()) facts_.version = identity->version;
    if (!identity->axes.empty()) facts_.axes = identity->axes;
    if (identity->receive_buffer > 0) facts_.receive_buffer = identity->receive_buffer;
  } else if (const auto* offset = std::get_if<cnc::WorkOffset>(&event)) {
    if (offset->name == "G54") facts_.g54 = *offset;
  } else if (std::holds_alternative<cnc::Banner>(event)) {
    question_ = Question::kNone;
    question_until_ = kNever;
    facts_.status.reset();
    has_spoken_ = true;
    query_status(now);
  } else if (std::holds_alternative<cnc::Acknowledged>(event) && question_ != Question::kNone) {
    return answered("");
  } else if (const auto* rejected = std::get_if<cnc::Rejected>(&event);
             rejected && question_ != Question::kNone) {
    return answered("The CNC refused " + request(*device_, question_).substr(0, 2) + ": " +
                    rejected->sentence + ".");
  }
  out.push_back(event);
}

std::vector<CncSession::Event> CncSession::tick(Instant now) {
  std::vector<Event> out;
  if (now >= silent_at_) {
    silent_at_ = kNever;
    out.push_back(Silent{"The CNC has not answered a status query for " +
                         std::to_string(times_.silence / std::chrono::milliseconds(1)) + " ms."});
  }
  if (now >= question_until_) {
    const std::string asked = request(*device_, question_).substr(0, 2);
    question_ = Question::kNone;
    question_until_ = kNever;
    out.push_back(Silent{"The CNC has not answered " + asked + "."});
  }
  if (now >= next_poll_) query_status(now);
  return out;
}

Instant CncSession::next_deadline() const {
  return earlier(next_poll_, earlier(silent_at_, question_until_));
}

std::string CncSession::take_output() {
  return std::exchange(output_, {});
}

}  // namespace reforge
