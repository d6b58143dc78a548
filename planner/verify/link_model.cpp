#include "planner/verify/link_model.h"

#include <algorithm>

namespace reforge::verify {
namespace {

constexpr std::size_t kMotionQueue = 15;  // grbl's; grblHAL has more
constexpr double kBitsPerByte = 10;       // 8N1

}  // namespace

std::size_t bytes_sent(const gcode::Line& line) {
  std::size_t count = 1;
  bool in_comment = false;
  for (const char c : line.text) {
    if (c == ';' && !in_comment) break;
    if (c == '(') in_comment = true;
    if (!in_comment && c != ' ' && c != '\t') ++count;
    if (c == ')') in_comment = false;
  }
  return count;
}

LinkModel::LinkModel(const CncLink& link)
    : bytes_per_s_(link.baud / kBitsPerByte),
      buffer_bytes_(static_cast<std::size_t>(link.receive_buffer_bytes)) {}

void LinkModel::barrier() {
  sent_ = taken_ = moved_ = 0;
  first_ = true;
  in_buffer_.clear();
  buffered_ = 0;
  queued_.clear();
}

double LinkModel::segment(std::size_t bytes, double seconds) {
  // Room in the receive buffer; a line longer than it waits until it is empty.
  double begin = sent_;
  while (!in_buffer_.empty() && buffered_ + bytes > buffer_bytes_) {
    begin = std::max(begin, in_buffer_.front().until);
    buffered_ -= in_buffer_.front().bytes;
    in_buffer_.pop_front();
  }
  sent_ = begin + static_cast<double>(bytes) / bytes_per_s_;
  // A place in the motion queue.
  taken_ = std::max(taken_, sent_);
  if (queued_.size() == kMotionQueue) {
    taken_ = std::max(taken_, queued_.front());
    queued_.pop_front();
  }
  in_buffer_.push_back({taken_, bytes});
  buffered_ += bytes;
  const double waited = first_ ? 0.0 : std::max(0.0, taken_ - moved_);
  moved_ = std::max(moved_, taken_) + seconds;
  queued_.push_back(moved_);
  first_ = false;
  return waited;
}

}  // namespace reforge::verify
