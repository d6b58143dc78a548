// The conversation with the extruder board: identity, orders, heartbeat, silence.
//
// Orders follow protocols/extruder_wire.h: one outstanding, numbered, re-sent until acknowledged,
// and finished by kDone (or by a status that names its number). M73 and M71 may overtake. A doubled
// or late answer changes nothing. The heartbeat is a status query, so a lost kDone is found by the
// next one. Starving: nothing is sent until the board's dead-man has cut heat and dropped its hold
// output (a way to make it safe that moves nothing); then the heartbeat returns to report the
// fault. Hellos that nobody answers pause as long, or a board that hears and cannot be heard would
// stay hot. Units: °C, mm, mm/s.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "controller/core/instant.h"
#include "controller/devices/extruder_order.h"
#include "protocols/extruder_wire.h"
#include "protocols/rig.h"

namespace reforge {

struct ExtruderTimes {
  Duration heartbeat = std::chrono::milliseconds(500);
  Duration heartbeat_extruding = std::chrono::milliseconds(150);
  Duration silence = std::chrono::milliseconds(2500);
  Duration silence_extruding = std::chrono::milliseconds(500);
  Duration acknowledge = std::chrono::milliseconds(100);  // then the order is sent again
  int attempts = 5;
  Duration hello = std::chrono::milliseconds(500);  // between hellos
  int hellos = 5;  // unanswered in a row; then a pause that lets the dead-man act
  Duration heat_up = std::chrono::minutes(10);  // kDone of M70
  Duration finish = std::chrono::seconds(15);   // kDone of the others
  Duration dead_man_margin = std::chrono::seconds(1);
};

class ExtruderLink {
 public:
  struct Identified {
    std::string version;
  };
  struct WrongBoard {
    std::string sentence;
  };  // version or settings we cannot work with
  struct Done {
    ExtruderOrder order;
  };
  struct Refused {
    ExtruderOrder order;
    std::string sentence;
  };  // refused, or did not come to its end
  struct Fault {
    std::string sentence;
  };  // latched fault, or the board was reset
  struct Lost {
    std::string sentence;
  };  // silence, or nobody acknowledges
  using Event = std::variant<Identified, WrongBoard, Done, Refused, Fault, Lost>;

  // `session_seed`: any number that differs from the previous daemon's, so that its orders are
  // stale.
  ExtruderLink(const RigDescription& rig, ExtruderTimes times, std::uint16_t session_seed);

  void opened(Instant now);
  void closed();
  std::vector<Event> receive(Instant now, std::string_view bytes);
  std::vector<Event> tick(Instant now);
  Instant next_deadline() const;

  // Queues an order. M73 and M71 displace what is queued and overtake an M-code that is
  // outstanding, which then ends without an event; but M73 changes nothing when M71 is on its way
  // already, and M71 waits for an M73 before it.
  void order(Instant now, const ExtruderOrder& order);
  void clear_fault(Instant now);
  void starve(Instant now);

  bool identified() const { return identified_ && status_; }
  bool busy() const;  // an order is outstanding or queued
  bool starving() const { return starving_; }
  bool warm() const;       // open and heated, by the board's word
  bool extruding() const;  // by our orders or by the board's word
  const std::optional<wire::Status>& status() const { return status_; }
  std::string take_output();

 private:
  struct Outstanding {
    wire::Frame frame;                   // numbered when it is first sent
    std::optional<ExtruderOrder> order;  // none: a setting, or clearing a fault
    bool acknowledged = false;
    int attempts = 0;
    Instant resend_at = kNever;
    Instant give_up_at = kNever;
    bool is(int m_code) const { return order && order->m_code == m_code; }
  };
  using Events = std::vector<Event>;

  void take(Instant now, const wire::Frame& frame, Events& out);
  void take_banner(Instant now, const wire::Banner& banner, Events& out);
  void take_setting(Instant now, const wire::SettingValue& value, Events& out);
  void take_status(Instant now, const wire::Status& status, Events& out);
  void take_ack(Instant now, const wire::Frame& frame, Events& out);
  void finish(Instant now, wire::Reason reason, Events& out);
  void judge_fault(wire::State state, wire::Fault fault, Events& out);
  void reject(std::string sentence, Events& out);
  void lose(Instant now, std::string sentence, Events& out);
  void beat(Instant now);  // hello, setting, or status query: whatever is next
  void transmit(Instant now, const wire::Frame& frame);
  void enqueue(Instant now, Outstanding next);
  void send_next(Instant now);
  void send_outstanding(Instant now);
  Instant silent_at() const;
  Instant starved_at() const;

  RigDescription rig_;
  ExtruderTimes times_;
  std::uint16_t session_;
  bool open_ = false;
  bool lost_ = false;        // reported as such; waits for opened()
  bool greeted_ = false;     // the banner of our session has come
  bool identified_ = false;  // settings agree and a status has come
  bool starving_ = false;
  bool fault_reported_ = false;
  bool wants_extrusion_ = false;  // M72 ordered and no M73 since
  int hellos_ = 0;                // unanswered so far
  std::size_t setting_ = 0;       // the next of the settings to compare
  std::uint8_t sequence_ = 0;     // of the last order
  std::uint8_t query_ = 0;        // of the last question
  std::string version_;
  wire::Decoder decoder_;
  Instant last_byte_{};
  Instant last_frame_{};  // a valid one, from the board
  Instant last_sent_{};
  Instant closer_since_{};  // since when the shorter deadline of extruding counts
  Instant quiet_until_{};   // a lost board is not greeted before
  Instant next_beat_ = kNever;
  Duration dead_man_ = std::chrono::seconds(3);  // the board's kSilence setting
  std::optional<Outstanding> outstanding_;
  std::deque<Outstanding> queue_;
  std::optional<wire::Status> status_;
  std::string output_;
};

}  // namespace reforge
