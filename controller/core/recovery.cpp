#include "controller/core/recovery.h"

namespace reforge {

std::optional<api::LineRange> unconfirmed_lines(const LineCertainty& certainty) {
  if (certainty.executed >= certainty.acknowledged) return std::nullopt;
  return api::LineRange{certainty.executed + 1, certainty.acknowledged};
}

std::optional<api::LineRange> uncertain_lines(const LineCertainty& certainty, bool sent_known) {
  const LineNumber last = sent_known ? certainty.sent : certainty.horizon;
  if (certainty.acknowledged >= last) return std::nullopt;
  return api::LineRange{certainty.acknowledged + 1, last};
}

std::string interruption_sentence(const LineCertainty& certainty, bool sent_known) {
  const auto range = [](const api::LineRange& r) {
    return r.first == r.last ? "line " + std::to_string(r.first)
                             : "lines " + std::to_string(r.first) + " to " + std::to_string(r.last);
  };
  std::string out = certainty.acknowledged == 0 ? std::string("No line was acknowledged")
                                                : "Line " + std::to_string(certainty.acknowledged) +
                                                      " is the last acknowledged";
  if (const auto lines = unconfirmed_lines(certainty)) {
    out += "; " + range(*lines) + " may not have been executed to the end";
  }
  if (const auto lines = uncertain_lines(certainty, sent_known)) {
    const char* sent = lines->first == lines->last ? " was sent and may have been executed"
                                                   : " were sent and may have been executed";
    out += "; " + range(*lines) + (sent_known ? sent : " may have been sent and executed");
  } else {
    out += "; nothing after it was sent";
  }
  return out + ".";
}

}  // namespace reforge
