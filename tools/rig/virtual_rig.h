// The virtual rig: simulated CNC and extruder board on one virtual time, with the wires between
// them. No I/O and no wall clock: bytes from the host go in, bytes for the host and a trace come
// out, and the same calls give the same bytes and trace.
//
// Wired as the real one: two serial links, the board's hold output to the CNC's hold input (low =
// hold, acts within a millisecond), the extruder port's DTR to the board's reset; with in-stream
// M-codes the CNC's outputs to the board's inputs and its ready output back. Opening the CNC's port
// resets nothing. A USB adapter hands bytes to the host once a millisecond. Both links run through
// a fault proxy (faulty_wire.h) that a script commands (rig_script.h).
#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>

#include "protocols/rig.h"
#include "tools/rig/cnc_controller.h"
#include "tools/rig/extruder_board.h"
#include "tools/rig/extruder_witness.h"
#include "tools/rig/faulty_wire.h"
#include "tools/rig/rig_script.h"
#include "tools/rig/trace.h"
#include "tools/rig/uart_line.h"

namespace reforge {

class VirtualRig {
 public:
  // `trace` may be null, otherwise it outlives the rig.
  VirtualRig(const RigDescription& rig, bool homed, std::unique_ptr<ExtruderBoard> board,
             Trace* trace, RigScript script = {});

  int64_t now_ns() const { return now_; }
  void host_wrote(Link link, std::string_view bytes);
  void dtr(Link link, bool high);

  // Goes on to `until_ns`, or less far: to the first millisecond that brings bytes for the host.
  void advance(int64_t until_ns);
  std::string take_for_host(Link link);

  // Something the host or the world did wrong, for the trace.
  void note_fault(std::string_view who, const std::string& what);

  // What the script wants of the ports themselves (kUnplug, kSwapPorts).
  std::vector<RigAction> take_port_actions();

  const CncController& cnc() const { return *cnc_; }
  int64_t filament_steps() const { return witness_.position(); }

 private:
  void step_to(int64_t ns);
  void run_cnc_to(int64_t ns);
  void run_script();
  void act(const RigAction& action);
  void pass_to_devices();
  void connect_in_stream();
  void watch_board();
  void write(int64_t ns, const char* event,
             nlohmann::ordered_json fields = nlohmann::ordered_json::object());
  void write_cnc_events();
  void write_witness(const Axes& at);
  void put_position(nlohmann::ordered_json& fields, const Axes& g54) const;

  std::unique_ptr<ExtruderBoard> board_;
  std::unique_ptr<CncController> cnc_;
  RigScript script_;
  std::array<FaultyWire, 2> to_device_, to_host_;  // by link
  std::vector<RigAction> port_actions_;
  bool in_stream_;
  Axes last_step_at_{};         // where the tool was at the last step of filament, in G54
  int64_t ready_since_ns_ = 0;  // the board's ready output rose
  bool ready_ = false;
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
