// What is known of a job that a crash, a power cut or `kill -9` left running: facts from the
// journal alone.
//
// Lines up to `executed` were drained; lines up to `acknowledged` were taken by the CNC and may
// have run; lines from there to `horizon` may have been sent. Nothing above `horizon` ever was.
// How such a job goes on: recovery_plan.h.
#pragma once

#include <optional>
#include <string>

#include "controller/core/job.h"

namespace reforge {

// Taken by the CNC, not certainly executed.
std::optional<api::LineRange> unconfirmed_lines(const LineCertainty& certainty);
// Possibly sent, not acknowledged. With `sent_known` false (after a crash) up to the horizon.
std::optional<api::LineRange> uncertain_lines(const LineCertainty& certainty, bool sent_known);

std::string interruption_sentence(const LineCertainty& certainty, bool sent_known);

}  // namespace reforge
