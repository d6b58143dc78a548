// The conversation with the CNC beside the program's lines: status polls, silence, identity,
// offsets.
//
// Polls at most at 5 Hz (status_period), plus one query at the moment a drain's dwell is
// acknowledged, so that a barrier does not wait for the next poll. Silence: a query unanswered for
// `silence`, once the device has spoken since its port was opened or it was reset (it may still be
// booting). While a question ($I, $#, $X) is open its acknowledgement belongs to it; no program
// line may be sent then (`asking()`).
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "controller/core/instant.h"
#include "controller/devices/cnc_device.h"

namespace reforge {

struct CncTimes {
  Duration status_period = std::chrono::milliseconds(200);
  Duration idle_status_period = std::chrono::milliseconds(500);
  Duration silence = std::chrono::milliseconds(1000);
  Duration question = std::chrono::milliseconds(3000);  // for an answer to $I, $#, $X
};

// Facts the device told us since its last banner.
struct CncFacts {
  std::optional<CncStatus> status;  // the last one
  Instant status_at{};
  std::string version;
  std::string axes;
  int receive_buffer = 0;
  std::optional<cnc::WorkOffset> g54;  // as of the last question
};

class CncSession {
 public:
  enum class Question : std::uint8_t { kNone, kIdentity, kOffsets, kUnlock };

  // What happened, in order. Answered ends a question, with an error sentence if it was rejected.
  struct Answered {
    Question question;
    std::string error;
  };
  struct Silent {
    std::string sentence;
  };
  using Event = std::variant<CncReport, Answered, Silent>;

  CncSession(std::unique_ptr<CncDevice> device, CncTimes times);

  void opened(Instant now);
  void closed();
  void reset_sent(Instant now);  // open questions die with the controller's buffer

  std::vector<Event> receive(Instant now, std::string_view bytes);
  std::vector<Event> tick(Instant now);
  Instant next_deadline() const;

  void ask(Instant now, Question question);  // asserts that none is open
  Question asking() const { return question_; }
  void query_status(Instant now);                 // at once
  void watch_closely(Instant now, bool closely);  // 5 Hz, or the idle rate

  std::string take_output();  // bytes to send, in order
  const CncDevice& device() const { return *device_; }
  const CncFacts& facts() const { return facts_; }

 private:
  void note(Instant now, const CncReport& event, std::vector<Event>& out);

  std::unique_ptr<CncDevice> device_;
  CncTimes times_;
  CncFacts facts_;
  Question question_ = Question::kNone;
  Instant question_until_ = kNever;
  Instant next_poll_ = kNever;
  Instant silent_at_ = kNever;  // armed by the oldest unanswered query
  bool closely_ = false;
  bool has_spoken_ = false;
  std::string output_;
};

}  // namespace reforge
