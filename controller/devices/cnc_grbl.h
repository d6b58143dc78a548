// The GRBL family's dialect (grbl 1.1 and grblHAL).
//
// Real-time bytes '?', '!', '~', 0x18 act at once wherever the stream is. `ok` means parsed and
// queued, not executed. An `error:N` does not flush what the receive buffer already holds. A
// welcome line in mid-job means that the controller was reset. Reports are taken to be in
// millimetres ($13=0). Source: RIG.md, "CNC links worth supporting"; grbl wiki v1.1 "Interface",
// for codes and reports.
#pragma once

#include <string>

#include "controller/devices/cnc_device.h"
#include "protocols/rig.h"

namespace reforge {

class CncGrbl final : public CncDevice {
 public:
  explicit CncGrbl(const CncLink& link);

  CncCapabilities capabilities() const override;
  FlowControl flow() const override;
  std::vector<CncReport> receive(std::string_view bytes) override;
  void forget() override;
  Result<std::string> encode(std::string_view words, LineNumber line) const override;
  std::string hold() const override;
  std::string resume() const override;
  std::string reset() const override;
  std::string status_query() const override;
  std::string identify() const override;
  std::string ask_offsets() const override;
  std::string unlock() const override;
  std::string_view drain_words() const override;

 private:
  CncLink link_;
  std::string line_;       // bytes of the line that is still arriving
  bool overlong_ = false;  // it has grown past any line of the dialect: dropped up to its end
};

// What the numbers mean, as a sentence; unknown numbers say so.
std::string grbl_error_sentence(int code);
std::string grbl_alarm_sentence(int code);

}  // namespace reforge
