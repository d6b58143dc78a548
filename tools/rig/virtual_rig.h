// The virtual rig: simulated CNC and extruder board on one virtual time, with the wires between
// them. No I/O and no wall clock: bytes from the host go in, bytes for the host and a trace come
// out, and the same calls give the same bytes and trace.
//
// Wired as the real one: two serial links, the board's hold output to the CNC's hold input (low =
// hold, acts within a millisecond), the extruder port's DTR to the board's reset. Opening the CNC's
// port resets nothing. A USB adapter hands bytes to the host once a millisecond.
// Limits: relay route only (the CNC's outputs are not wired to the board's inputs).
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>

#include "protocols/rig.h"
#include "tools/rig/extruder_board.h"
#include "tools/rig/extruder_witness.h"
#include "tools/rig/grbl_controller.h"
#include "tools/rig/trace.h"
#include "tools/rig/uart_line.h"

namespace reforge {

enum class Link { kCnc, kExtruder };
constexpr std::array<Link, 2> kLinks{Link::kCnc, Link::kExtruder};

class VirtualRig {
 public:
  // `trace` may be null, otherwise it outlives the rig.
  VirtualRig(const RigDescription& rig, bool homed, std::unique_ptr<ExtruderBoard> board,
             Trace* trace);

  int64_t now_ns() const { return now_; }
  void host_wrote(Link link, std::string_view bytes);
  void dtr(Link link, bool high);

  // Goes on to `until_ns`, or less far: to the first millisecond that brings bytes for the host.
  void advance(int64_t until_ns);
  std::string take_for_host(Link link);

  // Something the host or the world did wrong, for the trace.
  void note_fault(std::string_view who, const std::string& what);

  const GrblController& cnc() const { return cnc_; }
  int64_t filament_steps() const { return witness_.position(); }

 private:
  void step_to(int64_t ns);
  void run_cnc_to(int64_t ns);
  void watch_board();
  void write(int64_t ns, const char* event,
             nlohmann::ordered_json fields = nlohmann::ordered_json::object());
  void write_cnc_events();
  void write_witness(const Axes& at);
  void put_position(nlohmann::ordered_json& fields, const Axes& g54) const;

  GrblController cnc_;
  std::unique_ptr<ExtruderBoard> board_;
  ExtruderWitness witness_;
  Trace* trace_;
  UartLine to_cnc_, from_cnc_;
  std::array<std::string, 2> for_host_;
  int64_t now_ = 0;
  bool permitted_ = false;
  bool module_open_ = false;
  int resets_seen_ = 0;
  bool crash_noted_ = false;
  double noted_c_;
};

}  // namespace reforge
