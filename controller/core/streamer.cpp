#include "controller/core/streamer.h"

#include <algorithm>
#include <cassert>

namespace reforge {

Streamer::Streamer(std::shared_ptr<ProgramSource> program, const CncDevice& device,
                   const RigDescription& rig, StreamerOptions options)
    : program_(std::move(program)),
      device_(device),
      reader_(rig),
      options_(options),
      window_(device.flow().window),
      counts_bytes_(device.flow().kind == FlowControl::Kind::kCharacterCount) {
  assert(program_ && window_ > 0 && options_.horizon_ahead > 0);
  assert(options_.first_line >= 1 && options_.first_line <= program_->line_count() + 1);
  next_ = options_.first_line;
  const LineNumber done = next_ - 1;
  certainty_ = {done, done, done, done};
  horizon_asked_ = done;
}

void Streamer::limit_window(int bytes) {
  assert(certainty_.sent < options_.first_line);
  if (counts_bytes_ && bytes > 0) window_ = std::min(window_, bytes);
}

Status Streamer::look_ahead() {
  while (!encoded_ && !barrier_ && !checkpoint_ && next_ <= program_->line_count()) {
    Result<std::string_view> text = program_->line(next_);
    if (!text) return text.error();
    Result<ProgramLine> line = reader_.read(*text, next_);
    if (!line) return line.error();
    if (line->kind == ProgramLine::Kind::kNothing) {
      if (line->checkpoint && next_ - certainty_.executed > options_.checkpoint_every) {
        checkpoint_ = true;
        break;
      }
      ++next_;
      continue;
    }
    if (line->kind == ProgramLine::Kind::kBarrier && options_.relay) {
      barrier_ = std::move(*line);
      break;
    }
    Result<std::string> encoded = device_.encode(line->words, next_);
    if (!encoded) return encoded.error();
    if (counts_bytes_ && static_cast<int>(encoded->size()) > window_) {
      return Error{Code::kOutOfRange, "Line " + std::to_string(next_) + " has " +
                                          std::to_string(encoded->size()) +
                                          " bytes, more than the CNC's receiver holds (" +
                                          std::to_string(window_) + ")."};
    }
    encoded_ = std::move(*encoded);
    encoded_dwell_s_ = line->dwell_s;
  }
  return Unit{};
}

bool Streamer::has_room(int bytes) const {
  return counts_bytes_ ? in_flight_bytes_ + bytes <= window_
                       : static_cast<int>(in_flight_.size()) < window_;
}

void Streamer::push(InFlight sent) {
  in_flight_bytes_ += sent.bytes;
  dwell_in_flight_s_ += sent.dwell_s;
  in_flight_.push_back(sent);
  assert(!counts_bytes_ || in_flight_bytes_ <= window_);
}

Result<std::string> Streamer::pump() {
  std::string out;
  for (;;) {
    if (Status read = look_ahead(); !read) return read.error();
    if (!encoded_ || next_ > certainty_.horizon) break;
    const int bytes = static_cast<int>(encoded_->size());
    if (!has_room(bytes)) break;
    out += *encoded_;
    push({next_, bytes, encoded_dwell_s_});
    encoded_.reset();
    certainty_.sent = next_++;
  }
  return out;
}

bool Streamer::pump_drain(std::string& bytes) {
  Result<std::string> line = device_.encode(device_.drain_words(), 0);
  assert(line.ok());
  if (!has_room(static_cast<int>(line->size()))) return false;
  push({0, static_cast<int>(line->size()), 0.01});
  bytes += *line;
  return true;
}

Streamer::Settled Streamer::settle() {
  if (in_flight_.empty()) return Settled::kUnexpected;
  const InFlight done = in_flight_.front();
  in_flight_.pop_front();
  in_flight_bytes_ -= done.bytes;
  dwell_in_flight_s_ = in_flight_.empty() ? 0 : dwell_in_flight_s_ - done.dwell_s;
  // Blank and comment lines up to the next one outstanding have nothing to acknowledge.
  const LineNumber outstanding = next_unacknowledged();
  certainty_.acknowledged = outstanding > 0 ? outstanding - 1 : certainty_.sent;
  return done.line == 0 ? Settled::kDrain : Settled::kLine;
}

LineNumber Streamer::next_unacknowledged() const {
  for (const InFlight& entry : in_flight_) {
    if (entry.line > 0) return entry.line;
  }
  return 0;
}

bool Streamer::checkpoint_ahead() const {
  return checkpoint_ && next_ <= certainty_.horizon;
}

void Streamer::pass_checkpoint() {
  assert(checkpoint_ && in_flight_.empty());
  certainty_.sent = certainty_.acknowledged = certainty_.executed = next_++;
  checkpoint_ = false;
}

bool Streamer::barrier_ahead() const {
  return barrier_ && next_ <= certainty_.horizon;
}

void Streamer::begin_barrier() {
  assert(barrier_ahead() && in_flight_.empty());
  certainty_.sent = next_;
}

void Streamer::pass_barrier() {
  assert(barrier_ && certainty_.sent == next_);
  certainty_.acknowledged = certainty_.executed = next_++;
  barrier_.reset();
}

bool Streamer::at_end() const {
  return !encoded_ && !barrier_ && !checkpoint_ && next_ > program_->line_count() &&
         certainty_.horizon >= program_->line_count();
}

void Streamer::mark_executed() {
  assert(in_flight_.empty());
  if (at_end()) certainty_.sent = certainty_.acknowledged = program_->line_count();  // comments
  certainty_.executed = certainty_.acknowledged;
}

void Streamer::horizon_durable(LineNumber line) {
  assert(line <= program_->line_count());
  certainty_.horizon = std::max(certainty_.horizon, line);
}

std::optional<LineNumber> Streamer::wanted_horizon() {
  const LineNumber count = program_->line_count();
  const LineNumber reached = next_ - 1;
  if (horizon_asked_ >= count || horizon_asked_ - reached > options_.horizon_ahead / 2) {
    return std::nullopt;
  }
  horizon_asked_ = std::min(count, reached + options_.horizon_ahead);
  return horizon_asked_;
}

}  // namespace reforge
