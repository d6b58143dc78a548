// Watches the extruder board from outside and says what it did: steps as seen on the STEP pin, and
// M70-M75 as the board itself reported them done.
//
// Motion is taken from the pin alone. Which order a motion belongs to cannot be told from pulses
// (a restored length and a bead are both forward steps), so the boundaries are read from the wire:
// the board's `done` and `fault` frames, timed by the start bit of their first byte. Step counters
// in records are those of the pin at that time. In-stream they are read off the CNC's outputs and
// the board's ready output. Text mode is not followed. Filament stands still when no step came for
// 50 ms; while it moves, a sample every 20 ms says how far it is (and, with it, where the tool is).
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <string_view>
#include <vector>

#include "protocols/extruder_wire.h"
#include "tools/rig/extruder_board.h"
#include "tools/rig/trace.h"

namespace reforge {

class ExtruderWitness {
 public:
  void host_sent(std::string_view bytes);
  // `last_start_ns`: start bit of the last of these bytes.
  void board_sent(std::string_view bytes, int64_t last_start_ns);
  void stepped(const std::vector<FilamentStep>& steps);
  // In-stream: an M-code of the CNC's own has ended, by the board's ready output.
  void in_stream_done(int m_code, int64_t ns);
  void was_reset(int64_t ns, std::string_view cause);
  // Nothing later than `ns` has been reported: time for what shows by its absence.
  void looked_at(int64_t ns);

  int64_t position() const { return position_; }  // steps since power-on
  std::vector<TraceRecord> take();

 private:
  struct Order {
    uint8_t m_code;
    int32_t argument;
  };
  void host_frame(const wire::Frame& frame);
  void board_frame(const wire::Frame& frame, int64_t ns);
  void order_done(const Order& order, int64_t ns);
  void extrusion_off(int64_t ns, std::string_view by);
  int64_t position_at(int64_t ns) const;
  void record(int64_t ns, const char* event, nlohmann::ordered_json fields);

  wire::Decoder from_host_, from_board_;
  std::map<uint8_t, Order> orders_;  // by sequence
  bool extruding_ = false;
  int64_t position_ = 0;
  int moving_ = 0;  // direction of the motion under way
  int64_t last_step_ns_ = 0;
  int64_t sampled_ns_ = 0;
  std::deque<FilamentStep> recent_;
  std::vector<TraceRecord> records_;
};

}  // namespace reforge
