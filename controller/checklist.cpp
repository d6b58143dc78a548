#include "controller/checklist.h"

namespace reforge {

Checklist::Checklist(bool prints, bool recovers) {
  items_ = {{"stock",
             recovers ? "The part is clamped as the interrupted job left it."
                      : "The stock is the job's initial model, clamped on the pedestal.",
             ""},
            {"zero", "G54 is set to the part's origin with both rotary axes at 0.", ""},
            {"tool", "The cutter is the rig file's, sound and tight.", ""}};
  if (recovers) {
    items_.push_back({"homed",
                      "The machine was homed since; a nozzle in the part was heated first "
                      "(reheat), and stands clear of it.",
                      ""});
    items_.push_back({"preamble", "The preamble that recover has shown was read and may run.", ""});
  }
  if (!prints) return;
  items_.push_back({"filament", "Enough filament of the right kind is loaded.", ""});
  items_.push_back(
      {"hot", "The hot end may be heated: nozzle clean, heater and sensor seated.", ""});
  items_.push_back({"plate", "Plate and part are clear of chips, strings and tools.", ""});
}

Result<std::size_t> Checklist::find(const std::string& item) const {
  std::string names;
  for (std::size_t i = 0; i < items_.size(); ++i) {
    if (items_[i].item == item) return i;
    names += (names.empty() ? "" : ", ") + items_[i].item;
  }
  return Error{Code::kOutOfRange,
               "\"" + item + "\" is not on this job's checklist; it has " + names + "."};
}

void Checklist::forget() {
  for (api::ChecklistItem& item : items_) item.by.clear();
}

std::string Checklist::missing() const {
  std::string out;
  for (const api::ChecklistItem& item : items_) {
    if (item.by.empty()) out += (out.empty() ? "" : ", ") + item.item;
  }
  return out;
}

}  // namespace reforge
