// Single faults put into good programs, or into what they are verified with. Each kind has places;
// `apply` makes the fault at one of them, spread over the program. Deterministic.
#pragma once

#include <functional>

#include "tests/planner/verify_pairs.h"

namespace reforge::mutation {

struct Mutant {
  VerifyInputs inputs;
  std::string program;
};

using Lines = std::vector<std::string>;

inline Lines lines_of(const std::string& text) {
  Lines lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

inline bool starts(const std::string& line, const std::string& with) {
  return line.compare(0, with.size(), with) == 0;
}

// The number of a word, changed by `change`; false if the line has no such word.
inline bool change_word(std::string& line, char letter,
                        const std::function<double(double)>& change) {
  if (line.empty() || line[0] == ';') return false;
  const std::size_t at = line.find(letter);
  if (at == std::string::npos) return false;
  std::size_t end = at + 1;
  while (end < line.size() && line[end] != ' ') ++end;
  const double value = std::strtod(line.c_str() + at + 1, nullptr);
  line = line.substr(0, at + 1) + number(change(value), 4) + line.substr(end);
  return true;
}

// One kind of fault: where it can be made, and how. Faults of the text change `lines`; others
// change `inputs`.
struct Kind {
  std::string name;
  // Lines where it can be made; empty: `variants` faults of the inputs.
  std::function<bool(const Lines&, std::size_t)> at;
  std::function<void(Lines&, std::size_t)> edit;
  std::function<void(VerifyInputs&, std::size_t)> turn;
};

inline std::vector<Kind> kinds() {
  std::vector<Kind> all;
  const auto text = [&](const char* name, std::function<bool(const Lines&, std::size_t)> at,
                        std::function<void(Lines&, std::size_t)> edit) {
    all.push_back({name, std::move(at), std::move(edit), nullptr});
  };
  const auto inputs = [&](const char* name, std::function<void(VerifyInputs&, std::size_t)> turn) {
    all.push_back({name, nullptr, nullptr, std::move(turn)});
  };
  const auto word = [&](const char* name, char letter, std::function<double(double)> change) {
    text(
        name,
        [letter](const Lines& l, std::size_t k) {
          std::string line = l[k];
          return line[0] != 'M' && change_word(line, letter, [](double x) { return x; });
        },
        [letter, change](Lines& l, std::size_t k) { change_word(l[k], letter, change); });
  };
  const auto drop = [](Lines& l, std::size_t k) {
    l.erase(l.begin() + static_cast<std::ptrdiff_t>(k));
  };
  const auto begins = [](const char* with) {
    return [with](const Lines& l, std::size_t k) { return starts(l[k], with); };
  };
  const auto any = [](const Lines& l, std::size_t k) { return !l[k].empty() && l[k][0] != ';'; };

  word("Z lowered 0.3 mm", 'Z', [](double z) { return z - 0.3; });
  word("Z raised 0.3 mm", 'Z', [](double z) { return z + 0.3; });
  word("X off by 0.5 mm", 'X', [](double x) { return x + 0.5; });
  word("Y off by 0.5 mm", 'Y', [](double y) { return y - 0.5; });
  word("minus sign flipped", 'X', [](double x) { return -x; });
  text(
      "retract dropped",
      [](const Lines& l, std::size_t k) { return k > 0 && starts(l[k], "G0 Z"); }, drop);
  text(
      "rotary sign flipped",
      [](const Lines& l, std::size_t k) { return starts(l[k], "G0 B") || starts(l[k], "G0 A"); },
      [](Lines& l, std::size_t k) {
        change_word(l[k], l[k][3], [](double a) { return a == 0 ? 20 : -a; });
      });
  text(
      "C turned by 90",
      [](const Lines& l, std::size_t k) { return starts(l[k], "G0 B") || starts(l[k], "G0 A"); },
      [](Lines& l, std::size_t k) {
        change_word(l[k], 'C', [](double c) { return c > 0 ? c - 90 : c + 90; });
      });
  text(
      "rotary move dropped",
      [](const Lines& l, std::size_t k) { return starts(l[k], "G0 B") || starts(l[k], "G0 A"); },
      drop);
  text(
      "blocks swapped",
      [](const Lines& l, std::size_t k) {
        if (!starts(l[k], "; block")) return false;
        for (std::size_t n = k + 1; n < l.size(); ++n) {
          if (starts(l[n], "; block")) return true;
        }
        return false;
      },
      [](Lines& l, std::size_t k) {
        const auto begin = l.begin() + static_cast<std::ptrdiff_t>(k);
        const auto is_block = [](const std::string& s) { return starts(s, "; block"); };
        const auto middle = std::find_if(begin + 1, l.end(), is_block);
        const auto end = std::find_if(middle + 1, l.end(), [&](const std::string& s) {
          return is_block(s) || starts(s, "M71") || starts(s, "M30");
        });
        std::rotate(begin, middle, end);
      });
  text("M72 left on over a travel", begins("M73"), [](Lines& l, std::size_t k) {
    std::size_t end = k;  // everything of the extruder's up to the next bead
    while (end < l.size() && !starts(l[end], "M72")) ++end;
    for (std::size_t n = std::min(end, l.size() - 1) + 1; n-- > k;) {
      if (starts(l[n], "M7")) l.erase(l.begin() + static_cast<std::ptrdiff_t>(n));
    }
  });
  text("M73 dropped", begins("M73"), drop);
  text("M72 dropped", begins("M72"), drop);
  text("retraction dropped", begins("M74"), [](Lines& l, std::size_t k) {
    l.erase(l.begin() + static_cast<std::ptrdiff_t>(k),
            l.begin() + static_cast<std::ptrdiff_t>(k) + 2);
  });
  text("M75 dropped", begins("M75"), drop);
  text("M70 missing", begins("M70"), drop);
  text("M71 missing", begins("M71"), drop);
  text("too hot", begins("M70"), [](Lines& l, std::size_t k) { l[k] = "M70 S305"; });
  word("feed x 10", 'F', [](double f) { return f * 10; });
  word("feed / 10", 'F', [](double f) { return f / 10; });
  text("flow x 1.1", begins("M72"),
       [](Lines& l, std::size_t k) { change_word(l[k], 'P', [](double p) { return p * 1.1; }); });
  text("flow x 2", begins("M72"),
       [](Lines& l, std::size_t k) { change_word(l[k], 'P', [](double p) { return p * 2; }); });
  text("a line duplicated", any,
       [](Lines& l, std::size_t k) { l.insert(l.begin() + static_cast<std::ptrdiff_t>(k), l[k]); });
  text("a line lost", any, drop);
  text("a line cut short", any, [](Lines& l, std::size_t k) { l[k].resize(l[k].size() * 2 / 3); });
  text(
      "two lines swapped",
      [&](const Lines& l, std::size_t k) { return k + 1 < l.size() && !l[k].empty(); },
      [](Lines& l, std::size_t k) { std::swap(l[k], l[k + 1]); });
  text("a byte garbled", any,
       [](Lines& l, std::size_t k) { l[k][l[k].size() / 2] ^= static_cast<char>(1 << (k % 6)); });
  text(
      "two digits swapped",
      [](const Lines& l, std::size_t k) {
        if (l[k].empty() || l[k][0] == ';') return false;
        for (std::size_t n = 2; n < l[k].size(); ++n) {
          if (std::isdigit(l[k][n]) && std::isdigit(l[k][n - 1]) && l[k][n] != l[k][n - 1]) {
            return true;
          }
        }
        return false;
      },
      [](Lines& l, std::size_t k) {
        for (std::size_t n = 2; n < l[k].size(); ++n) {
          if (std::isdigit(l[k][n]) && std::isdigit(l[k][n - 1]) && l[k][n] != l[k][n - 1]) {
            std::swap(l[k][n], l[k][n - 1]);
            return;
          }
        }
      });
  text("G91 for G90", any, [](Lines& l, std::size_t k) {
    l.insert(l.begin() + static_cast<std::ptrdiff_t>(k), "G91");
  });
  text("inches for millimetres", any, [](Lines& l, std::size_t k) {
    l.insert(l.begin() + static_cast<std::ptrdiff_t>(k), "G20");
  });
  text("rapid for feed", begins("G1 "), [](Lines& l, std::size_t k) { l[k][1] = '0'; });
  text("feed for rapid", begins("G0 "), [](Lines& l, std::size_t k) { l[k][1] = '1'; });
  text("spindle not started", begins("M3 "), drop);
  text("spin-up not awaited", begins("M3 "),
       [](Lines& l, std::size_t k) { l.erase(l.begin() + static_cast<std::ptrdiff_t>(k) + 1); });
  text("spindle not stopped", begins("M5"), drop);
  text("spindle speed x 10", begins("M3 "),
       [](Lines& l, std::size_t k) { change_word(l[k], 'S', [](double s) { return s * 10; }); });
  text("the rest lost", any, [](Lines& l, std::size_t k) { l.resize(k); });
  text("a path lost", begins("; path"), [](Lines& l, std::size_t k) {
    std::size_t end = k + 1;
    while (end < l.size() && !starts(l[end], ";") && !starts(l[end], "M5") &&
           !starts(l[end], "M71")) {
      ++end;
    }
    l.erase(l.begin() + static_cast<std::ptrdiff_t>(k),
            l.begin() + static_cast<std::ptrdiff_t>(end));
  });

  inputs("pivot off by 1 mm", [](VerifyInputs& in, std::size_t k) {
    Kinematics& m = in.rig.kinematics;
    double* const of[] = {&m.tilt_offset_mm.z, &m.tilt_offset_mm.x, &m.c_axis_point_mm.x,
                          &m.c_axis_point_mm.y, &m.c_axis_point_mm.z};
    *of[k % 5] += k / 5 % 2 == 0 ? 1 : -1;
  });
  inputs("axis sign flipped", [](VerifyInputs& in, std::size_t k) {
    Kinematics& m = in.rig.kinematics;
    (k % 2 == 0 ? m.sign_tilt : m.sign_c) *= -1;
  });
  inputs("stock shifted 2 mm", [](VerifyInputs& in, std::size_t k) {
    Vec3 by = Vec3::Zero();
    by[static_cast<int>(k % 3)] = k / 3 % 2 == 0 ? 2 : -2;
    in.initial = translated(in.initial, by);
  });
  inputs("longer carriage", [](VerifyInputs& in, std::size_t k) {
    // The collet comes down over the cutter, to 2 mm, 4 mm, ... above the tip.
    const double from = 2 + 2 * static_cast<double>(k % 10);
    in.rig.cutter.flute_length_mm = std::min(in.rig.cutter.flute_length_mm, from);
    in.rig.cutter.holder = {{from, from + 60, 25, 25}};
  });
  inputs("another cutter", [](VerifyInputs& in, std::size_t k) {
    const double diameters[] = {2, 4, 6, 1, 3.5};
    in.rig.cutter.diameter_mm = diameters[k % 5];
  });
  inputs("nozzle off by 1 mm", [](VerifyInputs& in, std::size_t k) {
    auto& o = in.rig.nozzle.deployed_offset_mm;
    double* const of[] = {&o.x, &o.y, &o.z};
    *of[k % 3] += k / 3 % 2 == 0 ? 1 : -1;
  });
  inputs("wider nozzle", [](VerifyInputs& in, std::size_t k) {
    for (ToolSection& s : in.rig.nozzle.body) {
      s.r_from_mm += 0.5 * static_cast<double>(k % 10 + 1);
      s.r_to_mm += 0.5 * static_cast<double>(k % 10 + 1);
    }
  });
  inputs("less travel", [](VerifyInputs& in, std::size_t k) {
    LinearAxis* const of[] = {&in.rig.x, &in.rig.y, &in.rig.z};
    LinearAxis& axis = *of[k % 3];
    (k / 3 % 2 == 0 ? axis.max_mm : axis.min_mm) *= 0.1;
  });
  return all;
}

// Up to `places` mutants of one kind, spread over where it can be made. Visits each with its place.
inline std::size_t each_mutant(const SmallPair& pair, const Kind& kind, std::size_t places,
                               const std::function<void(const Mutant&, std::size_t)>& visit) {
  if (kind.turn) {
    const std::size_t count = std::min<std::size_t>(places, 10);
    for (std::size_t k = 0; k < count; ++k) {
      Mutant mutant{pair.inputs, pair.program};
      kind.turn(mutant.inputs, k);
      visit(mutant, k);
    }
    return count;
  }
  const Lines lines = lines_of(pair.program);
  std::vector<std::size_t> found;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    if (kind.at(lines, k)) found.push_back(k);
  }
  const std::size_t count = std::min(places, found.size());
  for (std::size_t n = 0; n < count; ++n) {
    const std::size_t k = found[(2 * n + 1) * found.size() / (2 * count)];
    Lines changed = lines;
    kind.edit(changed, k);
    std::string text;
    for (const std::string& line : changed) text += line + "\n";
    visit({pair.inputs, text}, k + 1);
  }
  return count;
}

}  // namespace reforge::mutation
