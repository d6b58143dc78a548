// The conversation with the extruder board: identity, orders, heartbeat, silence.
//
// Orders follow protocols/extruder_wire.h: one outstanding, numbered, re-sent until acknowledged,
// and finished by kDone (or by a status that names its number). M73 and M71 may overtake. A doubled
// or late answer changes nothing. The heartbeat is a status query, so a lost kDone is found by the
// next one. Starving: nothing is sent until the board's dead-man has cut heat and dropped its hold
// output (a way to make it safe that moves nothing); then the heartbeat returns to report the
// fault. Units: °C, mm, mm/s.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "controller/core/instant.h"
#include "protocols/extruder_wire.h"
#include "protocols/rig.h"

namespace reforge {

struct ExtruderTimes {
  Duration heartbeat = std::chrono::milliseconds(500);
  Duration heartbeat_extruding = std::chrono::milliseconds(150);
  Duration silence = std::chrono::milliseconds(2500);
  Duration silence_extruding = std::chrono::milliseconds(500);
  Duration acknowledge = std::chrono::milliseconds(60);  // then the order is sent again
  int attempts = 5;
  Duration hello = std::chrono::milliseconds(500);  // between hellos
  Duration heat_up = std::chrono::minutes(10);      // kDone of M70
  Duration finish = std::chrono::seconds(15);       // kDone of the others
  Duration dead_man_margin = std::chrono::seconds(1);
};

// An M-code with its argument: M70 °C, M72 mm of filament a second, M74 mm; others none.
struct ExtruderOrder {
  int m_code;
  double argument = 0;
  friend bool operator==(const ExtruderOrder&, const ExtruderOrder&) = default;
};
std::string to_string(const ExtruderOrder& order);  // "M72 P0.3466"

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

  // Queues an order. M73 and M71 displace what is queued and overtake what is outstanding, which
  // then ends without an event.
  void order(Instant now, const ExtruderOrder& order);
  void clear_fault(Instant now);
  void starve(Instant now);

  bool identified() const { return identified_; }
  bool busy() const;       // an order is outstanding or queued
  bool extruding() const;  // by our orders or by the board's word
  const std::optional<wire::Status>& status() const { return status_; }
  std::string take_output();

 private:
  struct Outstanding {
    wire::Frame frame;
    std::optional<ExtruderOrder> order;  // none: settings, clearing a fault
    bool acknowledged = false;
    int attempts = 0;
    Instant resend_at = kNever;
    Instant give_up_at = kNever;
  };

  void take(Instant now, const wire::Frame& frame, std::vector<Event>& out);
  void take_banner(Instant now, const wire::Banner& banner, std::vector<Event>& out);
  void take_setting(Instant now, const wire::SettingValue& value, std::vector<Event>& out);
  void take_status(Instant now, const wire::Status& status, std::vector<Event>& out);
  void finish(Instant now, wire::Reason reason, std::vector<Event>& out);
  void report_fault(wire::Fault fault, std::vector<Event>& out);
  void transmit(const wire::Frame& frame);
  void ask_next_setting(Instant now, std::vector<Event>& out);
  void send_next(Instant now);

  RigDescription rig_;
  ExtruderTimes times_;
  std::uint16_t session_;
  bool open_ = false;
  bool identified_ = false;
  bool greeted_ = false;  // banner of our session has come
  bool fault_reported_ = false;
  int setting_index_ = 0;
  std::uint8_t sequence_ = 0;  // of the last order
  std::uint8_t query_ = 0;     // of the last question
  wire::Decoder decoder_;
  Instant last_byte_ = Instant::zero();
  Instant last_frame_ = Instant::zero();  // a valid one, from the board
  Instant next_beat_ = kNever;
  Instant starve_until_ = Instant::zero();
  Duration dead_man_ = std::chrono::seconds(3);  // the board's kSilence setting
  std::optional<Outstanding> outstanding_;
  std::deque<Outstanding> queue_;
  std::optional<wire::Status> status_;
  bool wants_extrusion_ = false;  // M72 ordered and no M73 since
  std::string output_;
};

}  // namespace reforge
