/* Functions of FMI 3.0 that this FMU does not support; importers may still look them up. */

EXPORT fmi3Instance FMI(fmi3InstantiateScheduledExecution)(
  fmi3String instance_name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
  fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, void (*clock_update)(fmi3InstanceEnvironment),
  void (*lock)(void), void (*unlock)(void)) {
  (void)instance_name, (void)token, (void)resources, (void)visible, (void)logging;
  (void)environment, (void)logger, (void)clock_update, (void)lock, (void)unlock;
  return NULL;
}

/* All variables are of type Float64. */
#define NONE_OF(type)                                                                                                \
  EXPORT fmi3Status FMI(fmi3Get##type)(fmi3Instance c, References r, size_t n, fmi3##type v[], size_t m) {           \
    (void)r, (void)v, (void)m;                                                                                       \
    return n ? complain(c, STATUS_ERROR, "there are no variables of this type", "") : STATUS_OK;                     \
  }                                                                                                                  \
  EXPORT fmi3Status FMI(fmi3Set##type)(fmi3Instance c, References r, size_t n, const fmi3##type v[], size_t m) {     \
    (void)r, (void)v, (void)m;                                                                                       \
    return n ? complain(c, STATUS_ERROR, "there are no variables of this type", "") : STATUS_OK;                     \
  }
NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(Int32)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)

/* An unsupported function. */
#define LACKING(function, arguments, ...)                                           \
  EXPORT fmi3Status FMI(function) arguments {                                       \
    __VA_ARGS__;                                                                    \
    return complain(c, STATUS_ERROR, " is not offered by this FMU", #function);     \
  }

LACKING(fmi3GetBinary,
    (fmi3Instance c, References r, size_t n, size_t sizes[], fmi3Binary v[], size_t m),
    (void)r, (void)n, (void)sizes, (void)v, (void)m)
LACKING(fmi3SetBinary,
    (fmi3Instance c, References r, size_t n, const size_t sizes[], const fmi3Binary v[], size_t m),
    (void)r, (void)n, (void)sizes, (void)v, (void)m)
LACKING(fmi3GetClock, (fmi3Instance c, References r, size_t n, fmi3Clock v[]), (void)r, (void)n, (void)v)
LACKING(fmi3SetClock, (fmi3Instance c, References r, size_t n, const fmi3Clock v[]), (void)r, (void)n, (void)v)
LACKING(fmi3GetNumberOfVariableDependencies, (fmi3Instance c, fmi3ValueReference r, size_t *n), (void)r, (void)n)
LACKING(fmi3GetVariableDependencies,
    (fmi3Instance c, fmi3ValueReference r, size_t dependent[], fmi3ValueReference independent[],
         size_t element[], fmi3DependencyKind kind[], size_t n),
    (void)r, (void)dependent, (void)independent, (void)element, (void)kind, (void)n)
LACKING(fmi3GetIntervalDecimal,
    (fmi3Instance c, References r, size_t n, fmi3Float64 v[], fmi3IntervalQualifier q[]),
    (void)r, (void)n, (void)v, (void)q)
LACKING(fmi3GetIntervalFraction,
    (fmi3Instance c, References r, size_t n, fmi3UInt64 counter[], fmi3UInt64 v[], fmi3IntervalQualifier q[]),
    (void)r, (void)n, (void)counter, (void)v, (void)q)
LACKING(fmi3GetShiftDecimal, (fmi3Instance c, References r, size_t n, fmi3Float64 v[]), (void)r, (void)n, (void)v)
LACKING(fmi3GetShiftFraction,
    (fmi3Instance c, References r, size_t n, fmi3UInt64 counter[], fmi3UInt64 v[]),
    (void)r, (void)n, (void)counter, (void)v)
LACKING(fmi3SetIntervalDecimal,
    (fmi3Instance c, References r, size_t n, const fmi3Float64 v[]),
    (void)r, (void)n, (void)v)
LACKING(fmi3SetIntervalFraction,
    (fmi3Instance c, References r, size_t n, const fmi3UInt64 counter[], const fmi3UInt64 v[]),
    (void)r, (void)n, (void)counter, (void)v)
LACKING(fmi3SetShiftDecimal, (fmi3Instance c, References r, size_t n, const fmi3Float64 v[]), (void)r, (void)n, (void)v)
LACKING(fmi3SetShiftFraction,
    (fmi3Instance c, References r, size_t n, const fmi3UInt64 counter[], const fmi3UInt64 v[]),
    (void)r, (void)n, (void)counter, (void)v)
LACKING(fmi3GetOutputDerivatives,
    (fmi3Instance c, References r, size_t n, const fmi3Int32 order[], fmi3Float64 v[], size_t m),
    (void)r, (void)n, (void)order, (void)v, (void)m)
LACKING(fmi3GetAdjointDerivative,
    (fmi3Instance c, References unknown, size_t unknowns, References known, size_t knowns,
         const fmi3Float64 seed[], size_t n, fmi3Float64 sensitivity[], size_t m),
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)n, (void)sensitivity, (void)m)
LACKING(fmi3ActivateModelPartition,
    (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time),
    (void)clock, (void)time)

#if !OFFERS_MODEL_EXCHANGE
LACKING(fmi3CompletedIntegratorStep,
    (fmi3Instance c, fmi3Boolean final, fmi3Boolean *enter_event_mode, fmi3Boolean *terminate),
    (void)final, (void)enter_event_mode, (void)terminate)
LACKING(fmi3SetTime, (fmi3Instance c, fmi3Float64 time), (void)time)
LACKING(fmi3SetContinuousStates, (fmi3Instance c, const fmi3Float64 x[], size_t n), (void)x, (void)n)
LACKING(fmi3GetContinuousStateDerivatives,
    (fmi3Instance c, fmi3Float64 derivatives[], size_t n),
    (void)derivatives, (void)n)
LACKING(fmi3GetContinuousStates, (fmi3Instance c, fmi3Float64 x[], size_t n), (void)x, (void)n)
LACKING(fmi3GetNominalsOfContinuousStates, (fmi3Instance c, fmi3Float64 nominals[], size_t n), (void)nominals, (void)n)
LACKING(fmi3GetNumberOfContinuousStates, (fmi3Instance c, size_t *n), (void)n)
LACKING(fmi3GetEventIndicators, (fmi3Instance c, fmi3Float64 indicators[], size_t n), (void)indicators, (void)n)
LACKING(fmi3GetNumberOfEventIndicators, (fmi3Instance c, size_t *n), (void)n)
#endif
