/* Effects that the machine may have beside those of sea and rig: one list, from which come the struct, its defaults and the
   names on the command line. EACH(name, default) has a value for each side, `name_1` and `name_2`, or `name` for both;
   ONE(name, default) has one. All are off by default: the machine is then that of sea or rig, to the last bit. */

#define EFFECTS(EACH, ONE)                                                                                             \
  /* ropes */                                                                                                          \
  EACH(rope_mass, 0.0)          /* kg/m along the rope, which then carries longitudinal waves; 0: none */              \
  ONE(segments, 4.0)            /* of a rope with mass, of equal length, with half a segment's mass at each end */     \
  EACH(modulus_factor, 1.0)     /* of the drawn modulus */                                                             \
  EACH(damping_factor, 1.0)     /* of the drawn Kelvin-Voigt damping of the whole rope */                              \
  ONE(damping_length, 0.0)      /* m: the damping goes as 1/L and is that above at this length; 0: whatever the length */ \
  EACH(loss_factor, 0.0)        /* of the rope, as damping loss k/w at the resonance of drum and rope, beside the above */ \
  ONE(wound, 0.0)               /* 1: rope on a drum counts in its inertia */                                          \
  ONE(spare_length, 0.0)        /* m of rope that stays on a drum when all else is paid out */                         \
  ONE(skin_friction, 0.0)       /* coefficient of the water's friction along the rope; 0.01 for strands */             \
  ONE(diameter, 0.024)          /* m of the rope, for its drags */                                                     \
  EACH(dahl_force, 0.0)         /* N: Dahl's hysteresis of the rope, its largest force */                              \
  ONE(dahl_strain, 4e-6)        /* strain after which Dahl's force has changed by 1 - 1/e of the way */                \
  /* sag */                                                                                                            \
  EACH(submerged_weight, 0.0)   /* N/m of rope in water, across; 0: no sag */                                          \
  ONE(roller_spacing, 0.0)      /* m between rollers; 0: one span */                                                   \
  EACH(transverse_mass, 0.0)    /* kg/m that moves across, with added water; 0: the sag follows the tension at once */ \
  ONE(transverse_drag, 0.0)     /* coefficient of drag across; 1.2 for strands */                                      \
  ONE(roller_friction, 0.0)     /* coefficient of friction along, times the submerged weight */                        \
  /* winches */                                                                                                        \
  EACH(inertia_factor, 1.0)     /* of the drawn inertia at the drum (Table 1's 1.8 kg m^2) */                          \
  EACH(drum_inertia, 0.0)       /* kg m^2 beside that */                                                               \
  EACH(rotor_inertia, 0.0)      /* kg m^2 at the motor's shaft; 36^2 times as much at the drum */                      \
  EACH(gear_stiffness, 0.0)     /* N m/rad at the drum, between rotor and drum; 0: rigid */                            \
  EACH(gear_damping, 0.0)       /* N m s/rad at the drum, while teeth touch */                                         \
  EACH(backlash, 0.0)           /* rad at the drum, from flank to flank; of a gearbox that gives */                    \
  EACH(transmission_error, 0.0) /* rad at the drum, amplitude at each of 6 and 36 waves a turn */                      \
  EACH(transmission_angle, 0.0) /* rad, phase of these waves */                                                        \
  EACH(gear_efficiency, 1.0)    /* share of the torque that the gearbox passes on, either way */                       \
  /* sensors */                                                                                                        \
  ONE(wheel_error, 0.0)         /* share by which the speed sensor reads too much */                                   \
  ONE(cell_bandwidth, 0.0)      /* Hz of the load cells' first-order lag; 0: none */                                   \
  ONE(cell_at_vehicle, 0.0)     /* 1: load cells at the vehicle's end of the ropes, 0: at the drums */                 \
  ONE(torque_step, 0.0)         /* N m: steps of torque commands, as on a fieldbus; 0: none */                         \
  ONE(slack_below, 0.0)         /* N: a rope with no more tension than this counts as slack */                         \
  EACH(sheave, 0.0)             /* mu theta of the rope over a sheave by the drum, beyond the load cell at the drum */ \
  ONE(position_late, 0.0)       /* s by which the position sensor is late; up to 127 samples */                        \
  ONE(position_rate, 0.0)       /* its readings a second, each held until the next; 0: one a sample */                 \
  ONE(fault_start, 20.0)        /* s: begin of the first of these faults */                                            \
  ONE(fault_length, 0.5)        /* s */                                                                                \
  ONE(fault_period, 1e3)        /* s from one to the next */                                                           \
  ONE(position_fault, 0.0)      /* m by which the position is off meanwhile, as by multipath */                        \
  ONE(wheel_slip, 0.0)          /* share by which the speed wheel reads too much meanwhile */                          \
  EACH(encoder_slip, 0.0)       /* m of rope that an encoder loses in each, at a constant rate */                      \
  EACH(cell_drift, 0.0)         /* N by which a load cell drifts, exponentially from the start */                      \
  ONE(drift_time, 15.0)         /* s */                                                                                \
  /* rail */                                                                                                           \
  ONE(break_away, 1.0)          /* Stribeck: friction at rest over that in motion */                                   \
  ONE(stribeck_speed, 0.01)     /* m/s */                                                                              \
  ONE(bristle_stiffness, 0.0)   /* N/m, LuGre's sigma_0; 0: friction as the tanh of the speed */                       \
  ONE(bristle_damping, 0.0)     /* N s/m, LuGre's sigma_1 */                                                           \
  ONE(rail_tilt, 0.0)           /* rad, upwards along the track */                                                     \
  ONE(rail_wave, 0.0)           /* rad, amplitude of the slope of a wavy rail */                                       \
  ONE(rail_wavelength, 10.0)    /* m */                                                                                \
  /* vortices */                                                                                                       \
  ONE(shedding_by_way, 0.0)     /* 1: their phase goes with the way since the start; 0: with speed times time */        \
  ONE(shedding_phase, 0.0)      /* rad, at the start */                                                                 \
  /* overloads */                                                                                                      \
  ONE(push_force, 0.0)          /* N against the vehicle's motion along the track, from push_start on */                \
  ONE(push_start, 20.0)         /* s */                                                                                \
  ONE(push_length, 0.3)         /* s */                                                                                \
  ONE(payload_mass, 0.0)        /* of a payload that comes at payload_start, over the vehicle's mass */                 \
  ONE(payload_drag, 0.0)        /* likewise, over the vehicle's drag */                                                \
  ONE(payload_start, 20.0)      /* s */                                                                                \
  EACH(lag_factor, 1.0)         /* of the drawn lag of the motor */                                                    \
  EACH(most_torque, 0.0)        /* N m of the motor at base_speed and below; 0: no limit */                            \
  ONE(base_speed, 0.0)          /* rad/s of the motor beyond which its power is constant; 0: its torque is */          \
  EACH(rated_torque, 0.0)       /* N m that the motor bears for ever; beyond it most_torque for overload_time; 0: no heat */ \
  ONE(overload_time, 30.0)      /* s; then rated_torque until it has cooled to half (I2t) */                           \
  EACH(dropout_start, 20.0)     /* s from which on a drive has no torque */                                            \
  EACH(dropout_length, 0.0)     /* s */                                                                                \
  /* a damping of drum speeds beside the exported controller, tau -= damping (omega - v_ref/R) */                      \
  ONE(speed_damping, 0.0)       /* N m s/rad, of the drum's speed at the motor */                                      \
  ONE(speed_lag, 0.0)           /* s, first-order lag of the measured drum speed */                                    \
  ONE(speed_noise, 0.0)         /* rad/s of the measured drum speed */                                                 \
  /* readings corrected as an estimator would that has learnt so large a share (0 to 1) of what they get wrong */         \
  ONE(learnt_gear, 0.0)         /* of the twist of the gearbox at the measured tension, in the encoder's angle */       \
  ONE(learnt_sag, 0.0)          /* of what sag takes of the rope at the measured tension, in the encoder's angle */     \
  ONE(learnt_modulus, 0.0)      /* of the stretch of a rope softer or harder than Table 1's, in the encoder's angle */  \
  ONE(learnt_wheel, 0.0)        /* of the speed sensor's scale */                                                      \
  /* the integration, of a machine with any effect in its plant */                                                     \
  ONE(integrator, 1.0)          /* 0: Runge-Kutta, 1: linearly implicit midpoint rule */                               \
  ONE(substeps, 0.0)            /* a sample; 0: 64 of Runge-Kutta, 16 of the midpoint rule */
